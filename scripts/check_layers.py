#!/usr/bin/env python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Checks that includes in libcvmesh point upstream only, and that third-party headers stay where
they belong. Prints one line per fault and exits with 1 if there is one.

    scripts/check_layers.py [REPOSITORY]
"""

import pathlib
import re
import sys

# Folders of libcvmesh/cvmesh in the order in which data flows; folders on one line are independent.
LAYERS = [
    ["core"],
    ["grid", "mesh"],
    ["labels"],
    ["levelset"],
    ["interfaces"],
    ["medial"],
    ["sizing"],
    ["particles"],
    ["surface"],
    ["tet"],
    ["metrics"],
    ["params"],
    ["report"],
    ["pipeline"],
]
RANK = {folder: rank for rank, folders in enumerate(LAYERS) for folder in folders}
STAGES = ["labels", "levelset", "interfaces", "medial", "sizing", "particles", "surface", "tet"]

# What one stage may read of another: types, not algorithms.
TYPE_HEADERS = {
    "labels/label_volume.h",
    "levelset/level_sets.h",
    "medial/medial_axis.h",
    "sizing/sizing_field.h",
    "particles/particle_set.h",
}
# Shared tools that are no stage's algorithm: lattice connectivity, simple changes, point search.
TOOL_HEADERS = {
    "labels/lattice_components.h",
    "labels/lattice_topology.h",
    "labels/simple_change.h",
    "medial/point_tree.h",
}
# io reads and writes the data types, and is used by the pipeline and the apps only.
IO_READS = {"core", "grid", "mesh", "labels"}
# Constants only, so that logs of all stages use the same names.
READ_BY_ALL = {"pipeline/stage_names.h"}

# Third-party headers that our headers may include, and where.
PUBLIC_THIRD_PARTY = {
    "core/parallel.h": {"tbb"},
    "mesh/material_surfaces.h": {"CGAL", "boost"},
}
# Small forward declarations of a JSON value.
HARMLESS = {"nlohmann/json_fwd.hpp"}
# Libraries that only files of one name prefix may include.
CONFINED = {"itk": "itk_", "tetgen": "tetgen_"}
THIRD_PARTY = re.compile(r"(CGAL|CLI|Eigen|boost|catch2|itk|nanoflann|nlohmann|spdlog|tbb|tetgen)")

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.MULTILINE)


def may_include(source, target):
    """Whether a file of libcvmesh may include a header of it; both relative to cvmesh/."""
    source_folder, target_folder = source.split("/")[0], target.split("/")[0]
    if source_folder == target_folder or target in READ_BY_ALL:
        return True
    if "io" in (source_folder, target_folder):
        reads_io = target_folder == "io" and source_folder == "pipeline"
        return reads_io or (source_folder == "io" and target_folder in IO_READS)
    if source_folder not in RANK or target_folder not in RANK:
        return False
    if RANK[target_folder] >= RANK[source_folder]:
        return False
    if source_folder in STAGES and target_folder in STAGES:
        return target in TYPE_HEADERS | TOOL_HEADERS
    return True


def third_party_fault(source, header):
    """Why a file of libcvmesh may not include a third-party header, or None."""
    library = THIRD_PARTY.match(header)
    if library is None or header in HARMLESS:
        return None
    name = source.rsplit("/", 1)[-1]
    prefix = CONFINED.get(library.group(1))
    if prefix is not None and not name.startswith(prefix):
        return f"<{header}> belongs into {prefix}*.cpp files"
    if source.endswith(".h") and library.group(1) not in PUBLIC_THIRD_PARTY.get(source, set()):
        return f"<{header}> belongs into .cpp files"
    return None


def faults_of(root):
    library = root / "libcvmesh"
    for path in sorted(library.glob("cvmesh/**/*")):
        if path.suffix not in (".h", ".cpp"):
            continue
        source = path.relative_to(library / "cvmesh").as_posix()
        for bracket, header in INCLUDE.findall(path.read_text(encoding="utf-8")):
            if header.startswith("cvmesh/"):
                target = header[len("cvmesh/"):]
                if not may_include(source, target):
                    yield f"{source}: includes {header}, which is not upstream of it"
            elif bracket == '"':
                yield f'{source}: includes "{header}"; write "cvmesh/<folder>/{header}"'
            else:
                fault = third_party_fault(source, header)
                if fault is not None:
                    yield f"{source}: {fault}"


def main():
    root = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else pathlib.Path(__file__).parents[1]
    faults = list(faults_of(root))
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
