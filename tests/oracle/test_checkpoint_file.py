"""Checkpoints are what `docs/reference/checkpoint.md` says, judged by h5py and Python's own SHA-256."""

import hashlib
import json

import h5py
import numpy as np
import pytest

SEAL = 512
TYPES = ("float64", "uint64", "int64", "uint32", "uint8")


def in_order(group):
    return sorted(group.items(), key=lambda item: item[1].attrs["order"])


def content_hash(file):
    """The hash of the page, from what h5py reads."""
    lines = ["head " + hashlib.sha256(file.attrs["head"].encode()).hexdigest()]
    for name, group in in_order(file):
        lines.append(f"{name} {group.attrs['version']}")
        for array, dataset in in_order(group):
            extents = ",".join(map(str, dataset.shape))
            digest = hashlib.sha256(np.ascontiguousarray(dataset[()]).tobytes()).hexdigest()
            lines.append(f"{name}/{array} {dataset.dtype.name} ({extents}) {digest}")
    return hashlib.sha256("".join(line + "\n" for line in lines).encode()).hexdigest()


@pytest.fixture(scope="module")
def checkpoints(run_scene):
    out = run_scene("sample_assets/scenes/hanging_sheet.toml", "1001-1004", resolution=12)
    found = sorted((out / "checkpoints").glob("frame_*.h5"))
    assert found, "a finished run leaves a checkpoint at its last frame"
    return found


def test_the_seal_is_the_length_and_the_hash_of_the_rest(checkpoints):
    for path in checkpoints:
        whole = path.read_bytes()
        digest = hashlib.sha256(whole[SEAL:]).hexdigest()
        seal = f"Drapery checkpoint 1\nbytes {len(whole)}\nsha256 {digest}\n".encode()
        assert whole[:SEAL] == seal.ljust(SEAL, b"\0")


def test_the_content_hash_is_that_of_head_groups_and_arrays(checkpoints):
    for path in checkpoints:
        with h5py.File(path, "r") as file:
            assert file.attrs["content_hash"] == content_hash(file)


def test_attributes_say_the_same_as_the_head(checkpoints):
    for path in checkpoints:
        with h5py.File(path, "r") as file:
            head = json.loads(file.attrs["head"])
            for name in ("format_version", "application", "shot", "frame", "sub_step", "time"):
                assert file.attrs[name] == head[name], name
            assert [file.attrs["fps_numerator"], file.attrs["fps_denominator"]] == head["fps"]
            assert file.attrs.get("delivered") == head["delivered"]
            assert path.name.startswith(f"frame_{head['frame']:05}.")


def test_arrays_are_plain_and_of_the_types_of_the_page(checkpoints):
    for path in checkpoints:
        with h5py.File(path, "r") as file:
            assert "positions" in file["state"] and "velocities" in file["state"]
            for _, group in in_order(file):
                for _, dataset in in_order(group):
                    assert dataset.dtype.name in TYPES and dataset.dtype.byteorder in "<=|"
                    assert dataset.chunks is None and dataset.compression is None


def test_the_account_belongs_to_its_checkpoint(checkpoints):
    for path in checkpoints:
        account = json.loads(path.with_suffix(".json").read_text())
        with h5py.File(path, "r") as file:
            assert account["content_hash"] == file.attrs["content_hash"]
        assert account["attempt"] >= 1 and account["record_bytes"] > 0
