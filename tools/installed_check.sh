#!/usr/bin/env bash
# The installed tool on its own: installs tvc into a temporary folder, and from an empty one flies,
# writes the files of the image, runs the rig behind a pseudo-terminal and examines it. The image in
# the program must be the one that the source tree builds. Takes some minutes.
set -euo pipefail
tree=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/empty"

# Another folder than that of the developer's own builds, as on a machine that installs it once.
time cargo install --quiet --locked --path "$tree/ground" --root "$work/installed" --target-dir "$work/target"
rm -r "$work/target"
tvc=$work/installed/bin/tvc
ls -l "$tvc"

cd "$work/empty"
"$tvc" fly --start 0.4
"$tvc" flash --elf f.elf --bin f.bin --uf2 f.uf2
"$tvc" rig --pty --seconds 2
"$tvc" bringup --rig --no-hands
ls -l f.*
(cd "$tree" && cargo tvc flash --bin "$work/empty/tree.bin")
cmp f.bin tree.bin
echo "the installed tool works by itself, and its image is the tree's"
