"""What the pages have that MkDocs does not know: links to files of the repository, info strings of several words, and lists and
tables that begin without an empty line.

The pages are also read where the repository is hosted, so they link scenes, sources and licences by their paths. The book gets a
copy of each file that is linked, under `files/`; a link to a file that does not exist is left to MkDocs, which refuses it.
"""

import os
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
LINK = re.compile(r"(\]\()([^)\s#:]+)((?:#[^)\s]*)?\))")
linked = set()


def on_page_markdown(markdown, page, config, files):
    folder = (DOCS / page.file.src_uri).parent

    def target(match):
        path = Path(os.path.normpath(folder / match[2]))
        if path.is_dir() and DOCS in path.parents and (path / "README.md").is_file():
            return f"{match[1]}{os.path.relpath(path / 'README.md', folder)}{match[3]}"
        if DOCS in path.parents or not path.is_file():
            return match[0]
        linked.add(path)
        # HTML, because MkDocs looks at links of Markdown only.
        return f"{match[1]}https://book.invalid/{up}files/{path.relative_to(ROOT)})"

    markdown = re.sub(r"^(?!\* |- |\d+\. |\||#|  )(.+)\n(?=\* |- |1\. |\|.*\n\|---)", r"\1\n\n", markdown, flags=re.MULTILINE)
    # Pages of rustdoc are made after the book, beside it.
    up = "../" * page.file.src_uri.count("/")
    markdown = re.sub(r"`(rustdoc/[a-z_]+/index\.html)`", rf"[\1](https://book.invalid/{up}\1)", markdown)
    # A fence such as ```sh run: what follows the language is for the tests.
    markdown = re.sub(r"^```(\w+) [^\n]*$", r"```\1", markdown, flags=re.MULTILINE)
    return LINK.sub(target, markdown)


def on_post_page(output, page, config):
    return output.replace("https://book.invalid/", "")


def on_post_build(config):
    for path in sorted(linked):
        copy = Path(config["site_dir"]) / "files" / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
