#!/usr/bin/env bash
# Checks that the ground tool compiles for Windows and macOS, without building or running it there.
# Needs rustup, which installs the standard library of each, and no other compiler.
set -euo pipefail
cd "$(dirname "$0")/.."

for target in x86_64-pc-windows-gnu aarch64-apple-darwin; do
  printf '\n== %s\n' "$target"
  rustup target add "$target"
  # The image for the chip has nothing to do with the system of the tool.
  TVC_IMAGE=none cargo check --package ground --bin tvc --target "$target" --target-dir target/other
done
