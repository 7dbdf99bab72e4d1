#!/bin/bash
# Makes a character and its garments, simulates a walk that turns into a dance, and renders six of its frames.
# Called by `make demo`, which has built the commands. Argument: light or full, the garments' resolution.
set -euo pipefail
cd "$(dirname "$0")/.."

quality=$1
scene=sample_assets/scenes/dressed_mannequin.toml
assets=demo/assets
out=demo/out-$quality
case $quality in
light | full) ;;
*)
    echo "demo: QUALITY is light or full, not '$quality'" >&2
    exit 2
    ;;
esac

echo "demo: 1 of 3, the character and its garments ($quality) go to $assets"
"$DRAPERY_ASSETS" mannequin --out "$assets" --garments "$quality"

echo "demo: 2 of 3, simulating $scene; the caches go to $out"
"$DRAPERY" run "$scene" --frames 1001-1097 --out "$out" --overwrite --set "assets=$PWD/$assets"

echo "demo: 3 of 3, rendering six frames with Blender"
garments=()
for cache in "$out"/*.abc; do
    garments+=(--garment "$cache")
done
.venv/bin/python tests/oracle/render_contact_sheet.py --body "$assets/body.abc" "${garments[@]}" \
    --frames 1001,1020,1039,1058,1077,1097 --out "$out/contact_sheet.jpg"

echo
echo "caches:   $(printf '%s ' "$PWD/$out"/*.abc)"
echo "picture:  $PWD/$out/contact_sheet.jpg"
echo "to load them in Blender, paste this into its Python console:"
printf 'for f in ['
for cache in "$PWD/$assets/body.abc" "$PWD/$out"/*.abc; do
    printf "'%s', " "$cache"
done
printf ']: bpy.ops.wm.alembic_import(filepath=f, as_background_job=False)\n'
