"""Finishes the bill of materials of cargo-cyclonedx: no folders of this machine, and the C library of HDF5.

python3 bill_of_materials.py WORKSPACE BILL.json FOLDER_OF_HDF5_METNO_SRC
"""

import json
import re
import sys
import uuid
from pathlib import Path

CRATE = "hdf5-metno-src"


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


def main():
    workspace, file, crate = sys.argv[1:]
    text = Path(file).read_text().replace(f"path+file://{workspace}/", "path+workspace:").replace(workspace, "")
    bill = json.loads(re.sub(r"\?download_url=file://[^#\"]*", "", text))
    library = hdf5(Path(crate))
    bill["components"].append(library)
    owner = next(each for each in bill["dependencies"] if each["ref"].split("#")[-1].startswith(f"{CRATE}@"))
    owner.setdefault("dependsOn", []).append(library["bom-ref"])
    bill["dependencies"].append({"ref": library["bom-ref"]})
    # A number that depends on the content alone: the same commit has the same bill.
    content = json.dumps(bill, sort_keys=True)
    bill["serialNumber"] = uuid.uuid5(uuid.NAMESPACE_URL, content).urn
    print(json.dumps(bill, indent=1))


main()
