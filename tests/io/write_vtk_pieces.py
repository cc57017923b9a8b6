#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Has VTK read a .vtu file and write it in three pieces, in each of its ways to store data, and once
with ghost cells: those of the neighbours that touch a piece. Exits with 77 where VTK's Python is
missing.

    write_vtk_pieces.py FILE FOLDER
"""

import sys

try:
    from vtkmodules.vtkFiltersParallel import vtkExtractUnstructuredGridPiece
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader, vtkXMLUnstructuredGridWriter
except ImportError:
    sys.exit(77)

source, folder = sys.argv[1:]
reader = vtkXMLUnstructuredGridReader()
reader.SetFileName(source)
pieces = vtkExtractUnstructuredGridPiece()
pieces.SetInputConnection(reader.GetOutputPort())


def write(mode, compressor, ghost_levels, name):
    pieces.SetCreateGhostCells(ghost_levels)
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputConnection(pieces.GetOutputPort())
    writer.SetNumberOfPieces(3)
    writer.SetGhostLevel(ghost_levels)
    getattr(writer, f"SetDataModeTo{mode}")()
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    writer.SetFileName(f"{folder}/{name}.vtu")
    writer.Write()


for mode in ("Ascii", "Binary", "Appended"):
    for compressor in ("None", "ZLib"):
        write(mode, compressor, 0, f"{mode}_{compressor}")
write("Appended", "ZLib", 1, "ghosts")
