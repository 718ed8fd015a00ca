#!/usr/bin/env bash
# The files of a release: the image as .elf, .bin and .uf2, and their SHA256SUMS.
#
#   tools/release.sh FOLDER     writes them into FOLDER
#   tools/release.sh --check    builds once more in a clone, at another path and with another
#                               CARGO_HOME, and compares; takes some three minutes
#
# The bytes depend on the sources, the compiler (rust-toolchain.toml) and the kind of computer it
# runs on, and on nothing else.
set -euo pipefail
tree=$(cd "$(dirname "$0")/.." && pwd)

release() { # TREE FOLDER: the tool builds the tree round the folder that it is started in
  local name
  name=tvc-nano-$(sed -n 's/^version = "\(.*\)"/\1/p' "$1/Cargo.toml" | head -1)
  (cd "$1" && "$tool" flash --elf "$2/$name.elf" --bin "$2/$name.bin" --uf2 "$2/$name.uf2")
  (cd "$2" && sha256sum "$name".{elf,bin,uf2} > SHA256SUMS)
}

build_tool() {
  (cd "$tree" && cargo tvc --version)
  tool=${CARGO_TARGET_DIR:-$tree/target}/tool/tvc
}

case "${1:-}" in
  --check)
    changed=$(git -C "$tree" status --porcelain)
    if [ -n "$changed" ]; then
      printf 'error: the clone would not have what is not committed:\n%s\n' "$changed" >&2
      exit 1
    fi
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    mkdir -p "$work/another/folder" "$work/home" "$work/here" "$work/there"
    git clone --quiet "$tree" "$work/another/folder/clone"
    # Sources of dependencies at another path, without a download.
    ln -s "${CARGO_HOME:-$HOME/.cargo}/registry" "$work/home/registry"
    build_tool
    release "$tree" "$work/here"
    unset CARGO_TARGET_DIR
    CARGO_HOME=$work/home release "$work/another/folder/clone" "$work/there"
    diff "$work/here/SHA256SUMS" "$work/there/SHA256SUMS"
    cat "$work/here/SHA256SUMS"
    echo "the same bytes in both folders"
    ;;
  "" | -*)
    sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
  *)
    mkdir -p "$1"
    build_tool
    release "$tree" "$(cd "$1" && pwd)"
    cat "$1/SHA256SUMS"
    ;;
esac
