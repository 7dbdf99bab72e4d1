"""Checks bills of materials: python check_bills.py THIRD_PARTY.txt BILL.cdx.json...

Each follows the schema of CycloneDX, has a licence for every component, and names no folder of a machine. Each has the HDF5 library, those with
the page of `drapery view` have three.js, and together they have every crate whose licence `THIRD_PARTY.txt` holds.
"""

import json
import re
import sys
from pathlib import Path

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator


def faults(licences, bills):
    found = set()
    for path in bills:
        text = path.read_text()
        if error := JsonStrictValidator(SchemaVersion.V1_5).validate_str(text):
            yield f"{path.name} breaks the schema: {error.data}"
        if "file:" in text:
            yield f"{path.name} names a file of this machine"
        bill = json.loads(text)
        components = [bill["metadata"]["component"], *bill["components"]]
        names = {component["name"] for component in components}
        inside = ["hdf5"] + (["three"] if "drapery-analysis" in names else [])
        yield from (f"{path.name}: {name} is missing" for name in inside if name not in names)
        for component in components:
            found.add((component["name"], component["version"]))
            if not component.get("licenses"):
                yield f"{path.name}: {component['name']} has no licence"
    crates = re.findall(r"^  (\S+) (\d\S*)  ", licences.read_text(), re.MULTILINE)
    if len(crates) < 50:
        yield f"{licences.name} has {len(crates)} crates: its form has changed"
    for name, version in sorted(set(crates) - found):
        yield f"{name} {version} is in no bill"


def main():
    licences, *bills = map(Path, sys.argv[1:])
    wrong = list(faults(licences, bills))
    print("\n".join(wrong))
    sys.exit(1 if wrong or not bills else 0)


main()
