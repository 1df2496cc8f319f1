"""Make Debian in a folder, and run commands in it as on a separate machine. As root, on Linux."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from pipeline.errors import StageError

MIRROR = "http://deb.debian.org/debian"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
SCRIPT = "/usr/share/debootstrap/scripts/sid"
"""What debootstrap does for all these releases; an older one does not know the names of newer releases."""
USER = "somebody"
PASSED = ("PIP_", "UV_", "http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY", "SSL_CERT", "REQUESTS_CA")
"""Prefixes of the variables that say how this machine reaches package registries."""
PIP_OF_USER = "etc/xdg/pip/pip.conf"
PIP_CONFIGURATIONS = {"/etc/pip.conf": "etc/pip.conf", "~/.pip/pip.conf": PIP_OF_USER, "~/.config/pip/pip.conf": PIP_OF_USER}

ENTER = """
root=$1 user=$2 folder=$3 command=$4
shift 4
mount -t proc proc "$root/proc"
mount --rbind /sys "$root/sys"
mount --rbind /dev "$root/dev"
for path; do mount --bind "$path" "$root$path"; done
hostname "$(cat "$root/etc/hostname")"
exec chroot --userspec="$user:$user" "$root" sh -c 'cd "$1" && eval "$2"' sh "$folder" "$command"
"""
"""Mounts are in a separate namespace and end with its last process."""


def network_variables() -> dict[str, str]:
    """Collect the variables of the environment that say how package registries are reached."""
    return {name: value for name, value in os.environ.items() if name.startswith(PASSED)}


@dataclass(frozen=True)
class Debian:
    """A Debian root, and the files of this machine that are visible in it."""

    root: Path
    binds: tuple[Path, ...] = ()

    def run(self, command: str, *, log: IO[str], user: str = "root", folder: str = "/") -> int:
        """Run a shell command as root or `USER` in a folder inside, log what it prints, and return its exit status."""
        environment = {"PATH": PATH, "HOME": f"/home/{user}" if user != "root" else "/root", "LANG": "C.UTF-8", "USER": user}
        namespaces = ["unshare", "--mount", "--pid", "--uts", "--fork", "--kill-child"]
        enter = ["sh", "-euc", ENTER, "sh", str(self.root), user, folder, command, *map(str, self.binds)]
        command_line, variables = [*namespaces, *enter], environment | network_variables()
        process = subprocess.run(command_line, env=variables, stdin=subprocess.DEVNULL, stdout=log, stderr=log, check=False)
        return process.returncode


def make_debian(base: Path, root: Path, release: str, *, mirror: str = MIRROR, binds: Sequence[Path] = ()) -> Debian:
    """Make a fresh Debian with git, make, and nothing of Python.

    Parameters
    ----------
    base
        What debootstrap made; made if it is not there.
    root
        The new root, a copy of it.
    release
        bookworm, trixie, testing …
    mirror
        Where packages come from.
    binds
        Files and folders of this machine that are seen at the same path, such as those that pip's configuration names.

    Raises
    ------
    StageError
        There is no debootstrap, or it failed.
    """
    if os.geteuid() != 0 or not shutil.which("debootstrap"):
        raise StageError("a Debian is made by root with debootstrap: apt-get install debootstrap")
    if not base.exists():
        unfinished = base.with_suffix(".unfinished")
        shutil.rmtree(unfinished, ignore_errors=True)
        command = ["debootstrap", "--variant=minbase", "--include=ca-certificates,git,make", release, str(unfinished), mirror, SCRIPT]
        if subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode:
            raise StageError(f"debootstrap of {release} from {mirror} failed; {unfinished}/debootstrap/debootstrap.log says why")
        unfinished.rename(base)
    shutil.rmtree(root, ignore_errors=True)
    subprocess.run(["cp", "-a", base, root], check=True)
    (root / "etc" / "hostname").write_text("vt-systems\n")
    (root / "etc" / "hosts").write_text("127.0.0.1 localhost vt-systems\n")
    shutil.copy("/etc/resolv.conf", root / "etc" / "resolv.conf")
    for source, target in PIP_CONFIGURATIONS.items():
        if (path := Path(source).expanduser()).is_file():
            (root / target).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, root / target)
    for path in Path("/etc/apt/apt.conf.d").glob("*"):
        if "Acquire::" in path.read_text(errors="ignore"):
            shutil.copy(path, root / "etc" / "apt" / "apt.conf.d")
    certificates = {Path(value) for name, value in network_variables().items() if Path(value).is_file()}
    visible = (*certificates, *(path.resolve() for path in binds))
    for path in visible:
        inside = root / path.relative_to("/")
        inside.parent.mkdir(parents=True, exist_ok=True)
        inside.mkdir(exist_ok=True) if path.is_dir() else inside.touch()
    subprocess.run(["chroot", root, "useradd", "--create-home", USER], check=True)
    return Debian(root.resolve(), visible)
