#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Meshes small volumes with four threads under the thread sanitizer, in every way that runs other
# parallel code, and exits non-zero when it reports anything. Reports stay in build/tsan/reports.
#
# oneTBB is built with the sanitizer, too, from Debian's source package: how threads wait for each
# other inside the packaged library is hidden from the sanitizer, which then calls every parallel
# loop a race. So no report needs to be suppressed, and a loop's own race is seen.
#
# usage: thread_sanitizer.sh [VOLUME...]    more volumes to mesh, besides two phantoms
set -eu
cd "$(dirname "$0")/.."

threads=4
build=$PWD/build/tsan
tbb=$build/onetbb
tbb_library=$tbb/build/onetbb_relwithdebinfo
reports=$build/reports

# From where the system has its packages; the lists of their sources stay out of its own.
build_onetbb() {
  apt="$tbb/apt"
  mkdir -p "$apt/lists/partial" "$apt/archives/partial" "$apt/sources"
  for file in /etc/apt/sources.list /etc/apt/sources.list.d/*; do
    case $file in
      *.list) [ ! -f "$file" ] || sed -n 's/^deb /deb-src /p' "$file" ;;
      *.sources) sed 's/^Types:.*/Types: deb-src/' "$file" >"$apt/sources/$(basename "$file")" ;;
    esac
  done >"$apt/sources/all.list"
  (
    cd "$tbb"
    set -- -o Dir::Etc::sourcelist=- -o Dir::Etc::sourceparts="$apt/sources" \
      -o Dir::State::lists="$apt/lists" -o Dir::Cache="$apt"
    apt-get "$@" update
    apt-get "$@" source onetbb
  )
  cmake -G Ninja -S "$tbb"/onetbb-*/ -B "$tbb/build" -DCMAKE_BUILD_TYPE=RelWithDebInfo \
    -DTBB_SANITIZE=thread -DTBB_TEST=OFF -DTBBMALLOC_BUILD=OFF -DTBB_STRICT=OFF \
    -DTBB_OUTPUT_DIR_BASE=onetbb
  cmake --build "$tbb/build" --target tbb
}

[ -e "$tbb_library/libtbb.so.12" ] || build_onetbb
cmake --preset tsan
cmake --build --preset tsan --target cvmesh_app cvmesh_tetgen cvmesh-phantom

rm -rf "$reports"
mkdir -p "$reports"
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
export LD_LIBRARY_PATH="$tbb_library"
export TSAN_OPTIONS="log_path=$reports/report exitcode=0 history_size=5"
status=0

# mesh_with VOLUME SETTING...
mesh_with() {
  volume=$1
  shift
  echo "thread_sanitizer: $(basename "$volume") $*"
  "$build/bin/cvmesh" mesh "$volume" --out "$out" --force --quiet --threads $threads "$@" ||
    status=1
}

"$build/bin/cvmesh-phantom" spheres --out "$out/spheres.nii.gz"
"$build/bin/cvmesh-phantom" torus --out "$out/torus.nii.gz"
for volume in "$out/spheres.nii.gz" "$out/torus.nii.gz" "$@"; do
  mesh_with "$volume" --report
done
for settings in schedule=sequential surface=delaunay target_vertices=800 max_distance_vox=0.5 \
  r=1.5 grid_spacing_mm=0.7 element_order=2; do
  mesh_with "$out/spheres.nii.gz" --set "$settings"
done
"$build/bin/cvmesh" metrics "$out/spheres.vtu" "$out/spheres.nii.gz" --threads $threads >/dev/null
"$build/bin/cvmesh" check "$out/spheres.nii.gz" --threads $threads

if [ -n "$(ls "$reports")" ]; then
  grep -h SUMMARY "$reports"/* | sort | uniq -c | sort -rn
  echo "thread_sanitizer: reports in $reports" >&2
  status=1
fi
exit $status
