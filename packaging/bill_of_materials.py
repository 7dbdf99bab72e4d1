"""Finishes the bill of materials of cargo-cyclonedx: no folders of this machine, and what is inside but is no crate: the C library of HDF5,
and the library of the page of `drapery view`.

python3 bill_of_materials.py WORKSPACE BILL.json FOLDER_OF_HDF5_METNO_SRC
"""

import json
import re
import sys
import uuid
from pathlib import Path

PAGE = Path("analysis/viewer/library/package-lock.json")


def hdf5(crate):
    """The component of the C library, which is linked in with the crate that has its sources."""
    header = (crate / "ext/hdf5/src/H5public.h").read_text()
    version = ".".join(re.search(rf"^#define H5_VERS_{part}\s+(\d+)", header, re.MULTILINE)[1] for part in ("MAJOR", "MINOR", "RELEASE"))
    return {
        "type": "library",
        "bom-ref": f"pkg:generic/hdf5@{version}",
        "name": "hdf5",
        "version": version,
        "description": "HDF5 library, in C",
        "scope": "required",
        "licenses": [{"license": {"id": "BSD-3-Clause"}}],
        "purl": f"pkg:generic/hdf5@{version}",
    }


def three(workspace):
    """The component of three.js, which a crate embeds."""
    package = json.loads((workspace / PAGE).read_text())["packages"]["node_modules/three"]
    reference = f"pkg:npm/three@{package['version']}"
    return {
        "type": "library",
        "bom-ref": reference,
        "name": "three",
        "version": package["version"],
        "description": "three.js, in the page of `drapery view`",
        "scope": "required",
        "licenses": [{"license": {"id": package["license"]}}],
        "purl": reference,
    }


def add(bill, component, owner):
    """Adds a component that the crate `owner` brings, if that crate is in the bill."""
    for crate in bill["dependencies"]:
        if re.search(rf"[/#]{owner}(#|@|$)", crate["ref"]):
            bill["components"].append(component)
            crate.setdefault("dependsOn", []).append(component["bom-ref"])
            bill["dependencies"].append({"ref": component["bom-ref"]})
            return


def main():
    workspace, file, crate = sys.argv[1:]
    text = Path(file).read_text().replace(f"path+file://{workspace}/", "path+workspace:").replace(workspace, "")
    bill = json.loads(re.sub(r"\?download_url=file://[^#\"]*", "", text))
    add(bill, hdf5(Path(crate)), "hdf5-metno-src")
    add(bill, three(Path(workspace)), "drapery-analysis")
    # A number that depends on the content alone: the same commit has the same bill.
    content = json.dumps(bill, sort_keys=True)
    bill["serialNumber"] = uuid.uuid5(uuid.NAMESPACE_URL, content).urn
    print(json.dumps(bill, indent=1))


main()
