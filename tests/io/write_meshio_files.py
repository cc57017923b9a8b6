#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Writes one small mesh in every form that meshio has for .vtu, .mesh and .msh files, and a
surface as .ply and .stl. Exits with 77 where meshio is missing.

    write_meshio_files.py FOLDER
"""

import sys

try:
    import meshio
    import numpy
except ImportError:
    sys.exit(77)

folder = sys.argv[1]
points = numpy.array([[0, 0, 0], [1, 0, 0], [0, 1.5, 0], [0, 0, 2], [1, 1, 0.1]])
tets = numpy.array([[0, 1, 2, 3], [1, 4, 2, 3]])
triangles = numpy.array([[0, 1, 2]])


def mesh(name):
    return meshio.Mesh(
        points,
        [("triangle", triangles), ("tetra", tets)],
        cell_data={name: [numpy.array([9], dtype=numpy.int32), numpy.array([2, 7], dtype=numpy.int32)]},
    )


for name, options in {
    "ascii": {"binary": False},
    "base64": {"binary": True, "compression": None},
    "zlib": {"binary": True, "compression": "zlib"},
    "base64_32": {"binary": True, "compression": None, "header_type": "UInt32"},
    "zlib_64": {"binary": True, "compression": "zlib", "header_type": "UInt64"},
}.items():
    meshio.vtu.write(f"{folder}/{name}.vtu", mesh("material"), **options)
meshio.medit.write(f"{folder}/medit.mesh", mesh("medit:ref"))
gmsh = mesh("gmsh:physical")
gmsh.cell_data["gmsh:geometrical"] = gmsh.cell_data["gmsh:physical"]
meshio.gmsh.write(f"{folder}/gmsh.msh", gmsh, fmt_version="2.2", binary=False)
meshio.gmsh.write(f"{folder}/gmsh_binary.msh", gmsh, fmt_version="2.2", binary=True)
surface = meshio.Mesh(points, [("triangle", numpy.array([[0, 1, 2], [0, 1, 3]]))])
meshio.ply.write(f"{folder}/text.ply", surface, binary=False)
meshio.ply.write(f"{folder}/binary.ply", surface, binary=True)
meshio.stl.write(f"{folder}/text.stl", surface, binary=False)
meshio.stl.write(f"{folder}/binary.stl", surface, binary=True)
