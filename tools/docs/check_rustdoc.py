#!/usr/bin/env python3
"""Runs `cargo doc` with the arguments given, and fails for links that lead nowhere.

Comments have units in brackets, as in [m/s], and indices, as in [i]; rustdoc takes each for a link to something of that name. So the
lint cannot simply be denied: what is in brackets here and is written like code (in back quotes, with `::`, or with a capital and small
letters) has to be a link that leads somewhere, all else is text.
"""

import json
import os
import re
import subprocess
import sys

LINT = "rustdoc::broken_intra_doc_links"


def is_meant_as_link(text):
    return "`" in text or "::" in text or re.fullmatch(r"[A-Z][a-z]+[A-Za-z0-9]*", text) is not None


def complaint(message):
    """Place and message of a link that leads nowhere; None for a message about something else."""
    if (message.get("code") or {}).get("code") != LINT:
        return None
    span = message["spans"][0]
    line = span["text"][0]
    # Where the comment is made of an attribute, or a macro, the span is the whole line: then the message names the link.
    between = line["text"][line["highlight_start"] - 1:line["highlight_end"] - 1]
    around = line["text"][:line["highlight_start"] - 1][-1:] + between + line["text"][line["highlight_end"] - 1:][:1]
    named = re.search(r"unresolved link to `([^`]*)`", message["message"])
    link = around if around.startswith("`") else between if len(between) < 60 else named[1] if named else between
    if not is_meant_as_link(link):
        return None
    return f"{span['file_name']}:{span['line_start']}: {message['message']}"


def main():
    flags = f"{os.environ.get('RUSTDOCFLAGS', '')} --force-warn {LINT}".strip()
    command = ["cargo", "doc", "--quiet", "--message-format", "json", *sys.argv[1:]]
    done = subprocess.run(command, env={**os.environ, "RUSTDOCFLAGS": flags}, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(done.returncode)
    messages = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    found = [complaint(message["message"]) for message in messages if message.get("reason") == "compiler-message"]
    broken = sorted({text for text in found if text})
    for text in broken:
        print(text, file=sys.stderr)
    sys.exit(f"{len(broken)} links of rustdoc lead nowhere" if broken else 0)


if __name__ == "__main__":
    main()
