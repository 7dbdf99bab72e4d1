"""Images and their containers by Buildah, which builds a Dockerfile without a daemon.

The images that FROM names come from no registry: they are made here, of Debian's smallest system (`mmdebstrap`). That of Rust has a C
compiler besides, and the Rust of this machine, which has to be of the version that the name asks for.
"""

import json
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

# Of the official images `rust:*-slim`.
WITH_RUST = ["ca-certificates", "gcc", "libc6-dev"]


def call(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout[-3000:]}{done.stderr[-6000:]}"
    return done.stdout.strip()


@dataclass
class Container:
    """A container, whose files are in `folder`."""

    store: "Images"
    name: str
    folder: Path

    def call(self, *words, user=None):
        """Runs words in the container, and returns what they print."""
        identity = ["--user", user] if user else []
        return self.store.buildah("run", "--isolation", "chroot", *identity, self.name, "--", *words)


class Images:
    """The images in a folder, which `with` clears of containers that hold mounts."""

    def __init__(self, folder):
        self.folder = folder

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.buildah("rm", "--all")

    def buildah(self, *words):
        return call("buildah", "--root", self.folder / "store", "--runroot", self.folder / "run", "--storage-driver", "vfs", *words)

    def container(self, image):
        name = self.buildah("from", "--pull-never", image)
        return Container(self, name, Path(self.buildah("mount", name)))

    def make_base(self, image):
        """Makes an image that FROM names."""
        found = re.fullmatch(r"debian:(\w+)-slim", image) or re.fullmatch(r"rust:[\d.]+-slim-(\w+)", image)
        assert found, f"it is not known how to make the image {image}"
        tar = self.folder / "base.tar"
        packages = [f"--include={','.join(WITH_RUST)}"] if image.startswith("rust:") else []
        call("mmdebstrap", "--quiet", "--variant=minbase", *packages, found[1], tar)
        name = self.buildah("from", "scratch")
        self.buildah("add", "--quiet", name, tar, "/")
        if packages:
            path = "/usr/local/rust/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
            self.buildah("config", "--env", f"PATH={path}", "--env", "CARGO_HOME=/usr/local/cargo", name)
        self.buildah("commit", "--quiet", "--rm", name, f"docker.io/library/{image}")
        tar.unlink()

    def build(self, project, name):
        """Builds the Dockerfile of a project; what FROM names has to be there."""
        text = (project / "Dockerfile").read_text()
        bases = re.findall(r"^FROM (\S+)", text, re.MULTILINE)
        for base in bases:
            self.make_base(base)
        mounts = {}
        if rust := next((base for base in bases if base.startswith("rust:")), None):
            # Crates that this machine has are not fetched again.
            crates = Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo")) / "registry"
            crates.mkdir(parents=True, exist_ok=True)
            mounts = {rust_of_this_machine(re.search(r"[\d.]+", rust)[0]): "/usr/local/rust", crates: "/usr/local/cargo/registry"}
        volumes = [word for source, place in mounts.items() for word in ("--volume", f"{source}:{place}")]
        self.buildah("build", "--pull-never", "--isolation", "chroot", *volumes, "--tag", name, project)

    def command(self, image):
        """The words that a container of an image begins with, and those that follow if nobody gives others."""
        about = json.loads(self.buildah("inspect", "--type", "image", image))["OCIv1"]["config"]
        return about["Entrypoint"], about["Cmd"]


def rust_of_this_machine(version):
    """The folder with Rust of a version."""
    for command in (["rustc"], ["rustup", "run", version, "rustc"]):
        found = subprocess.run([*command, "--version", "--verbose"], capture_output=True, text=True)
        if re.search(rf"^release: {re.escape(version)}\b", found.stdout, re.MULTILINE):
            return call(*command, "--print", "sysroot")
    raise AssertionError(f"the Dockerfile asks for Rust {version}; install it with: rustup toolchain install {version}")
