#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Has Gmsh mesh two boxes that share a face and save them as text and binary, in both versions and
both orders, with a physical group for each box and one for the surface of the first. Exits with 77
where Gmsh's Python is missing.

    write_gmsh_files.py FOLDER
"""

import sys

try:
    import gmsh
except ImportError:
    sys.exit(77)

folder = sys.argv[1]
gmsh.initialize(["-nopopup"])
gmsh.option.setNumber("General.Terminal", 0)
gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
for order in (1, 2):
    gmsh.model.add("boxes")
    first = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    second = gmsh.model.occ.addBox(1, 0, 0, 0.7, 1, 1)
    gmsh.model.occ.fragment([(3, first)], [(3, second)])
    gmsh.model.occ.synchronize()
    volumes = [tag for _, tag in gmsh.model.getEntities(3)]
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, volumes[:1], 40), 'bone "#1')
    gmsh.model.addPhysicalGroup(3, volumes[1:], 7)
    surface = [tag for _, tag in gmsh.model.getBoundary([(3, volumes[0])], oriented=False)]
    gmsh.model.addPhysicalGroup(2, surface, 41)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)
    for version in (2.2, 4.1):
        for is_binary in (0, 1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", is_binary)
            kind = "binary" if is_binary else "text"
            gmsh.write(f"{folder}/order{order}_{version}_{kind}.msh")
    gmsh.clear()
gmsh.finalize()
