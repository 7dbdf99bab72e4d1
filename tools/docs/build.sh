#!/bin/bash
# Builds the book, with the pages of rustdoc beside it, into the folder that the first argument names. Links that lead nowhere, in
# pages or in rustdoc, are errors. The second argument is `book` for the book alone. Called by `make docs`.
set -euo pipefail
cd "$(dirname "$0")/../.."

out=$(realpath -m "$1")
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
environment=$target/docs-environment
if ! cmp -s docs/requirements.txt "$environment/installed.txt"; then
    "$([ -x .venv/bin/python ] && echo .venv/bin/python || echo python3)" -m venv "$environment"
    "$environment/bin/python" -m pip install --quiet --disable-pip-version-check --requirement docs/requirements.txt
    cp docs/requirements.txt "$environment/installed.txt"
fi
NO_MKDOCS_2_WARNING=1 "$environment/bin/mkdocs" build --strict --quiet --site-dir "$out" || {
    NO_MKDOCS_2_WARNING=1 "$environment/bin/mkdocs" build --strict --site-dir "$out" >/dev/null
    exit 1
}
[ "${2:-}" != book ] || exit 0

# The profile of lints and tests, which have made what the crates stand on.
"$environment/bin/python" tools/docs/check_rustdoc.py --release --workspace --no-deps \
    --features drapery/mpi,drapery/usd --ignore-rust-version
cp -r "$target/doc" "$out/rustdoc"
for page in $(grep -rhoE 'rustdoc/[a-z_]+/index\.html' docs/reference/rust.md | sort -u); do
    [ -f "$out/$page" ] || {
        echo "docs: docs/reference/rust.md names $page, which rustdoc has not made" >&2
        exit 1
    }
done
echo "book: $out/index.html"
