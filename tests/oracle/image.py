"""Builds the Dockerfile without Docker: its steps, in roots that `mmdebstrap` makes of the Debian release that it names.

It knows the instructions that the Dockerfile has, and refuses others. A root is entered by `unshare` and `chroot`, with the network of
this machine. An image of Rust is Debian with a C compiler and the Rust of this machine, which has to be of the same version.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

# Of the official images `rust:*-slim`.
WITH_RUST = ["ca-certificates", "gcc", "libc6-dev"]


def call(*command, **options):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout[-3000:]}{done.stderr[-6000:]}"
    return done.stdout


@dataclass
class Root:
    """A root, and what instructions have said of it."""

    folder: Path
    environment: dict = field(default_factory=lambda: {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"})
    mounts: dict = field(default_factory=dict)  # folders of this machine, by their places in the root
    work: str = "/"
    entry: list = field(default_factory=list)
    arguments: list = field(default_factory=list)

    def command(self, *words, user=None):
        """Command line that runs words in the root, as Docker runs them in a container."""
        lines = ["set -e", f"cd {self.folder}", "mount -t proc proc proc", "mount --rbind /dev dev", "mount --rbind /sys sys"]
        for place, source in self.mounts.items():
            lines += [f"mkdir -p .{place}", f"mount --bind {shlex.quote(str(source))} .{place}"]
        identity = [f"--userspec={user}"] if user else []
        inside = ["chroot", *identity, ".", "/usr/bin/env", "-i", *(f"{name}={value}" for name, value in self.environment.items()),
                  "/bin/sh", "-c", f"cd {self.work} && exec \"$@\"", "sh", *words]
        lines.append("exec " + " ".join(shlex.quote(str(word)) for word in inside))
        return ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", "\n".join(lines)]

    def call(self, *words, user=None):
        """Runs words in the root, and returns what they print."""
        return call(*self.command(*words, user=user))


def debian(folder, release, packages=()):
    """A root with nothing but Debian's smallest system, and packages."""
    extra = [f"--include={','.join(packages)}"] if packages else []
    call("mmdebstrap", "--quiet", "--variant=minbase", *extra, release, folder)
    shutil.copy("/etc/resolv.conf", folder / "etc/resolv.conf")
    return Root(folder)


def base(image, folder):
    """The root of an image that FROM names."""
    if found := re.fullmatch(r"debian:(\w+)-slim", image):
        return debian(folder, found[1])
    found = re.fullmatch(r"rust:([\d.]+)-slim-(\w+)", image)
    assert found, f"no root is known for the image {image}"
    rust = rust_of_this_machine(found[1])
    root = debian(folder, found[2], WITH_RUST)
    # Crates that this machine has are not fetched again.
    crates = Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo")) / "registry"
    crates.mkdir(parents=True, exist_ok=True)
    root.mounts = {"/usr/local/rust": rust, "/usr/local/cargo/registry": crates}
    root.environment |= {"PATH": f"/usr/local/rust/bin:{root.environment['PATH']}", "CARGO_HOME": "/usr/local/cargo"}
    return root


def rust_of_this_machine(version):
    for command in (["rustc"], ["rustup", "run", version, "rustc"]):
        found = subprocess.run([*command, "--version", "--verbose"], capture_output=True, text=True)
        if re.search(rf"^release: {re.escape(version)}\b", found.stdout, re.MULTILINE):
            return call(*command, "--print", "sysroot").strip()
    raise AssertionError(f"the Dockerfile asks for Rust {version}; install it with: rustup toolchain install {version}")


def instructions(text):
    """Instructions with their arguments."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    for line in "\n".join(lines).replace("\\\n", "").splitlines():
        if line.strip():
            yield line.split(maxsplit=1)


class Build:
    """The roots of a Dockerfile, in a folder; `self.root` is the last one."""

    def __init__(self, project, folder):
        self.project, self.folder, self.stages = project, folder, {}
        self.ignored = (project / ".dockerignore").read_text().split()
        for name, rest in instructions((project / "Dockerfile").read_text()):
            step = getattr(self, f"do_{name.lower()}", None)
            assert step, f"Dockerfile: {name} is not known here"
            step(rest)

    def do_from(self, rest):
        image, *name = re.fullmatch(r"(\S+)(?: AS (\w+))?", rest).groups()
        self.root = base(image, self.folder / str(len(self.stages)))
        self.stages[name[0] or len(self.stages)] = self.root

    def do_run(self, rest):
        self.root.call("/bin/sh", "-c", rest)

    def do_copy(self, rest):
        words = rest.split()
        source = self.stages[words.pop(0).removeprefix("--from=")].folder if words[0].startswith("--from=") else self.project
        *names, to = words
        to_folder = self.root.folder / os.path.join(self.root.work, to).lstrip("/")
        for name in names:
            path = source / name.lstrip("/")
            if path.is_dir():
                # The content of a folder is copied, as Docker does.
                shutil.copytree(path, to_folder, symlinks=True, dirs_exist_ok=True, ignore=self.leave_out)
            elif to.endswith("/"):
                to_folder.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, to_folder)
            else:
                shutil.copy2(path, to_folder)

    def leave_out(self, folder, names):
        return [name for name in names if os.path.relpath(os.path.join(folder, name), self.project) in self.ignored]

    def do_workdir(self, rest):
        self.root.work = rest
        (self.root.folder / rest.lstrip("/")).mkdir(parents=True, exist_ok=True)

    def do_env(self, rest):
        name, value = rest.split("=", 1)
        self.root.environment[name] = value

    def do_entrypoint(self, rest):
        self.root.entry = json.loads(rest)

    def do_cmd(self, rest):
        self.root.arguments = json.loads(rest)
