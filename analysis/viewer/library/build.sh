#!/bin/bash
# Makes three.js for the page of `drapery view`: the names of library.js in one file, three.js beside it, which a build of the command
# then carries. npm checks every package against package-lock.json. Run again it only looks.
set -euo pipefail
cd "$(dirname "$0")"

made_of=$(cat package.json package-lock.json library.js build.sh | sha256sum | cut -c 1-64)
[ "$(tail -n 1 three.js 2>/dev/null)" != "//# made-of=$made_of" ] || exit 0
command -v npm >/dev/null || {
    echo "library of drapery view: npm is missing; install it (Debian: npm) and run the command again" >&2
    exit 1
}
echo "library of drapery view: bundling three.js"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp package.json package-lock.json .npmrc library.js "$work/"
(cd "$work" && npm ci --silent && npx --no-install esbuild library.js --bundle --minify --format=iife --global-name=THREE \
    --legal-comments=none --log-level=warning --outfile=three.js)
# The licence stands in the page, too.
{
    printf '/*!\nthree.js\n'
    cat "$work/node_modules/three/LICENSE"
    printf '*/\n'
    cat "$work/three.js"
    echo "//# made-of=$made_of"
} >"$work/whole.js"
mv "$work/whole.js" three.js
