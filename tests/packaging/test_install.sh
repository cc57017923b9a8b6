#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Installs the build into a folder, builds and runs the consumer example against it; makes the .deb,
# unpacks it and runs what is in it. A test (label "slow").
#
#   test_install.sh BUILD SOURCE VOLUME OUT
#
# Exits with 77 (skipped) where there is no dpkg-deb; the part before it has run then.
set -eu
build=$1
source=$2
volume=$3
out=$4
rm -rf "$out"
mkdir -p "$out"

cmake --install "$build" --prefix "$out/prefix" > "$out/install.log"
test -f "$out/prefix/share/man/man1/cvmesh.1"
test -f "$out/prefix/share/bash-completion/completions/cvmesh"
test -x "$out/prefix/share/cvmesh/cohort/slurm_cohort.sh"
"$out/prefix/bin/cvmesh" mesh "$volume" --out "$out/installed" --set epsilon=3 --quiet --force

cmake -S "$source/examples/consumer" -B "$out/consumer" "-DCMAKE_PREFIX_PATH=$out/prefix" \
  -DCMAKE_BUILD_TYPE=Release > "$out/consumer.log"
cmake --build "$out/consumer" >> "$out/consumer.log"
CVMESH_TETGEN_HELPER="$out/prefix/libexec/cvmesh/cvmesh-tetgen" \
  "$out/consumer/consumer" "$volume" "$out/consumed" > "$out/consumer.txt"
grep -E '^[1-9][0-9]* tets$' "$out/consumer.txt"

if ! command -v dpkg-deb > /dev/null || ! command -v dpkg-shlibdeps > /dev/null; then
  echo "skipped: no dpkg here"
  exit 77
fi
(cd "$build" && cpack -G DEB -B "$out/package" > "$out/cpack.log" 2>&1) || {
  cat "$out/cpack.log"
  exit 1
}
package=$(find "$out/package" -maxdepth 1 -name '*.deb')
dpkg-deb --field "$package" Package Version Depends
dpkg-deb --field "$package" Depends | grep -q libtbb
dpkg-deb --extract "$package" "$out/root"
"$out/root/usr/bin/cvmesh" --version
"$out/root/usr/bin/cvmesh" mesh "$volume" --out "$out/unpacked" --set epsilon=3 --quiet --force
# The same program: the same mesh.
cmp "$out/installed/$(ls "$out/installed" | grep '\.vtu$')" \
  "$out/unpacked/$(ls "$out/unpacked" | grep '\.vtu$')"
echo "ok"
