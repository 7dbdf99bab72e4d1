"""Words of the pages by who they are for. Tables, code and captions count; addresses of links do not."""

import re
import subprocess

from measure.page import Block, table
from measure.runs import OPTIONS, ROOT

# Section, its readers, and the paths that belong to it. The first pattern that fits a path decides.
SECTIONS = [
    ("README, CHANGELOG", "users", r"(README|CHANGELOG)\.md"),
    ("index", "users", r"docs/README\.md"),
    ("start", "users", r"docs/(start|tour)/.*"),
    ("how to", "users", r"docs/howto/.*"),
    ("measurements", "developers", r"docs/dev/measurements/.*|docs/(accuracy|self-contact|ranks|test-full)\.md"),
    ("decisions", "developers", r"docs/(dev/)?decisions/.*"),
    ("architecture, hard cases, fuzzing", "developers", r"docs/dev/.*|docs/(architecture|hard_cases|fuzzing)\.md"),
    ("theory", "developers", r"docs/theory/.*"),
    ("reference", "users", r"docs/reference/.*|docs/config\.md"),
    ("guide", "users", r"docs/.*"),
]


def words(text):
    return len(re.findall(r"[A-Za-z0-9_À-ÿ][\w.'’-]*", re.sub(r"\]\([^)]*\)", "]", text)))


def counted(commit):
    """Pages and words of each section, at a commit."""
    git = lambda *arguments: subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    found = {name: [0, 0] for name, _, _ in SECTIONS}
    for path in git("ls-tree", "-r", "--name-only", commit, "docs", "README.md", "CHANGELOG.md").splitlines():
        if path.endswith(".md"):
            name = next(name for name, _, pattern in SECTIONS if re.fullmatch(pattern, path))
            found[name] = [found[name][0] + 1, found[name][1] + words(git("show", f"{commit}:{path}"))]
    return found


def by_section():
    rows, (before, now) = [], (counted(OPTIONS.against), counted("HEAD"))
    for readers in ("users", "developers"):
        names = [name for name, whose, _ in SECTIONS if whose == readers]
        figures = [[*before[name], *now[name]] for name in names]
        for name, cells in [*zip(names, figures), (f"**all for {readers}**", [sum(column) for column in zip(*figures)])]:
            rows.append([name, readers, *(f"{cell:,}" for cell in cells)])
    return table(["section", "for", f"pages at {OPTIONS.against}", "words", "pages now", "words"], rows)


TABLES = [Block("dev/measurements/documentation.md", "words", "pages and words of each section", by_section)]
