"""Features of the pages that MkDocs does not know: links to files of the repository, info strings of several words, and lists
and tables that begin without an empty line.

The pages are also read where the repository is hosted, so they link scenes, sources and licences by their paths. The book gets a
copy of each file that is linked, under `files/`; a link to a file that does not exist is left to MkDocs, which refuses it.

Tables get what the style sheet needs to fit them into a page, and the index of the search gets users' words (`tools/docs/theme`).
"""

import html
import json
import os
import posixpath
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs"
TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
ROW = re.compile(r"<tr>.*?</tr>", re.DOTALL)
CELL = re.compile(r"(<t[dh](?: [^>]*)?>)(.*?)</t[dh]>", re.DOTALL)
CODE = re.compile(r"(<code>)(.*?)(</code>)", re.DOTALL)
HEADING_OR_TABLE = re.compile(r'<h[1-6] id="(?P<id>[^"]+)"|<table>.*?</table>', re.DOTALL)
TAG = re.compile(r"<[^>]+>")
LONG = re.compile(r"[^\s<>&;]{12,}")
# A table of as many columns holds numbers, in small print.
MANY = 7
LINK = re.compile(r"(\]\()([^)\s#:]+)((?:#[^)\s]*)?\))")
linked = set()
words = {}


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


def on_page_content(content, page, config, files):
    """Words by which the search finds a section: symptoms where they are listed, and the glossary's words where it leads to."""
    section = page.url
    for match in HEADING_OR_TABLE.finditer(content):
        if match["id"]:
            section = f"{page.url}#{match['id']}"
            continue
        table = match[0]
        first = CELL.search(table)
        for row in ROW.findall(table)[1:] if first and first[2] in ("you see", "you look for") else []:
            cell, here = CELL.findall(row)[:2]
            text = html.unescape(TAG.sub("", cell[1]))
            links = re.findall(r'href="([^"]+)"', here[1])
            targets = [section] if first[2] == "you see" else [posixpath.normpath(f"{page.url}/../{link}") for link in links]
            for target in targets:
                words.setdefault(target, []).append(text)


def on_post_page(output, page, config):
    output = TABLE.sub(fitted, output)
    return output.replace("https://book.invalid/", "")


def fitted(table):
    """A table that css/book.css can fit into a page: long names break, narrow pages know the columns, many columns are small."""
    head, _, body = table[0].partition("</thead>")
    columns = [html.escape(html.unescape(TAG.sub("", cell[2])).strip()) for cell in CELL.finditer(head)]
    head = CELL.sub(lambda cell: f"{cell[1]}{breaking(cell[2])}</th>", head)
    if len(columns) >= MANY:
        head = head.replace("<table>", '<table class="many">')

    def row(match):
        cells = iter(columns)

        def cell(match):
            column = next(cells, "")
            # The first cell is the heading of its row.
            name = f' data-column="{column}"' if column and column is not columns[0] else ""
            return match[1][:3] + name + match[1][3:] + CODE.sub(lambda code: code[1] + breaking(code[2]) + code[3], match[2]) + "</td>"

        return CELL.sub(cell, match[0])

    return f"{head}</thead>{ROW.sub(row, body)}"


def breaking(text):
    """Long names with places where a line may end."""
    return LONG.sub(lambda name: re.sub(r"([_/.=:,]+)(?=\w)", r"\1<wbr>", name[0]), text)


def on_post_build(config):
    index = Path(config["site_dir"]) / "search" / "search_index.json"
    content = json.loads(index.read_text())
    entries = {entry["location"]: entry for entry in content["docs"]}
    for location, texts in words.items():
        entries[location]["words"] = ", ".join(texts)
    index.write_text(json.dumps(content, sort_keys=True))

    for path in sorted(linked):
        copy = Path(config["site_dir"]) / "files" / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
