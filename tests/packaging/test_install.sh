#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Installs the build into a folder, completes command lines with its completion, builds and runs the
# consumer example against it; makes the .deb, installs (root) or unpacks it into a folder, asks apt
# whether it can be installed here, and runs what is in it. A test (label "slow").
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

# complete WORD...: what the shell would offer for the last word
complete_words() {
  PATH="$out/prefix/bin:$PATH" bash -c '
    source "$0"
    COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
    _cvmesh
    printf "%s\n" "${COMPREPLY[@]}"' "$out/prefix/share/bash-completion/completions/cvmesh" "$@"
}
complete_words cvmesh m | grep -qx mesh
complete_words cvmesh m | grep -qx metrics
complete_words cvmesh mesh --surf | grep -qx -e --surface-only
complete_words cvmesh mesh a.nii --space l | grep -qx lps
complete_words cvmesh mesh a.nii --formats vtu,in | grep -qx vtu,inp
[ -z "$(complete_words cvmesh mesh --no-such-option)" ]

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
if [ "$(id -u)" -eq 0 ]; then
  mkdir -p "$out/root/var/lib/dpkg/info" "$out/root/var/lib/dpkg/updates"
  touch "$out/root/var/lib/dpkg/status"
  # What it depends on is outside of this folder; apt is asked about that below.
  dpkg --root="$out/root" --force-depends --log="$out/dpkg.log" --install "$package" \
    > "$out/dpkg.txt" 2>&1 || {
    cat "$out/dpkg.txt"
    exit 1
  }
  dpkg-query --admindir="$out/root/var/lib/dpkg" -W -f '${Status}\n' cvmesh |
    grep -qx 'install ok installed'
else
  dpkg-deb --extract "$package" "$out/root"
fi
apt-get install --simulate --no-install-recommends "$package" > "$out/apt.txt" 2>&1
grep -q '^Inst cvmesh ' "$out/apt.txt"
"$out/root/usr/bin/cvmesh" --version
"$out/root/usr/bin/cvmesh" mesh "$volume" --out "$out/unpacked" --set epsilon=3 --quiet --force
# The same program: the same mesh.
cmp "$out/installed/$(ls "$out/installed" | grep '\.vtu$')" \
  "$out/unpacked/$(ls "$out/unpacked" | grep '\.vtu$')"
echo "ok"
