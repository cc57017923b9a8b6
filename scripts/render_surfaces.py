#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Draws surfaces side by side as a PNG: voxel faces of label volumes, and OFF files.

    scripts/render_surfaces.py femur.nii.gz r08/femur.stages/dense.off r3/femur.stages/dense.off picture.png

Needs python3-vtk9, python3-nibabel and, where there is no display, xvfb with xauth:
scripts/install_dependencies.sh --rendering
"""

import argparse
import os
import sys

from render_mesh import direction, ensure_display, fit, write_png

COLOUR = (0.93, 0.86, 0.74)
LINE, LINE_BEHIND = (0.55, 0.15, 0.12), (0.72, 0.74, 0.78)


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("inputs", nargs="+", help="label volumes (.nii, .nii.gz) and .off surfaces")
    parser.add_argument("image", help="PNG to write")
    parser.add_argument("--captions", nargs="+", default=[], help="one for each input")
    parser.add_argument("--normal", default="y", help="x, y, z or X,Y,Z: towards the camera")
    parser.add_argument("--turn", type=float, default=25, metavar="DEGREES")
    parser.add_argument("--lift", type=float, default=15, metavar="DEGREES")
    parser.add_argument("--part", type=float, nargs=2, default=[0, 1], metavar=("FROM", "TO"),
                        help="the part of the height that is shown, from 0 to 1")
    parser.add_argument("--edges", action="store_true", help="draw the edges of the .off surfaces")
    parser.add_argument("--section", metavar="SURFACE",
                        help="draw where each surface meets a plane across the middle of this one "
                             "(.off), over the same of this one")
    parser.add_argument("--size", default="400x600", metavar="WxH", help="pixels of each picture")
    return parser.parse_args()


def voxel_faces(path):
    """The faces between label 0 and the others as points (world) and quads."""
    import nibabel
    import numpy

    image = nibabel.load(path)
    inside = numpy.pad(numpy.asarray(image.dataobj) != 0, 1)
    points = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        after = numpy.roll(inside, -1, axis)
        for is_entry in (False, True):
            cut = numpy.argwhere(after & ~inside if is_entry else inside & ~after)
            corners = numpy.repeat(cut[:, None, :].astype(float) - 1, 4, axis=1)
            corners[:, :, axis] += 0.5
            ring = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
            for place, (du, dv) in enumerate(ring[::-1] if is_entry else ring):
                corners[:, place, u] += du
                corners[:, place, v] += dv
            points.append(corners.reshape(-1, 3))
    points = numpy.concatenate(points)
    return (nibabel.affines.apply_affine(image.affine, points),
            numpy.arange(len(points)).reshape(-1, 4))


def off_facets(path):
    import numpy

    with open(path) as stream:
        if stream.readline().strip() != "OFF":
            sys.exit(f"render_surfaces.py: {path}: no OFF file")
        points, facets, _ = (int(n) for n in stream.readline().split())
        coordinates = numpy.loadtxt(stream, max_rows=points)
        return coordinates, numpy.loadtxt(stream, max_rows=facets, dtype=int)[:, 1:4]


def poly_data(points, cells):
    import numpy
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    flat = numpy.hstack([numpy.full((len(cells), 1), cells.shape[1]), cells]).astype(numpy.int64)
    array = vtkCellArray()
    array.SetCells(len(cells), numpy_to_vtkIdTypeArray(flat.ravel(), deep=True))
    vtk_points = vtkPoints()
    vtk_points.SetData(numpy_to_vtk(numpy.ascontiguousarray(points), deep=True))
    data = vtkPolyData()
    data.SetPoints(vtk_points)
    data.SetPolys(array)
    return data


def shown(points, cells, part):
    """The cells whose middle is in a part of the height."""
    import numpy

    low, high = points[:, 2].min(), points[:, 2].max()
    middle = points[cells].mean(axis=1)[:, 2]
    place = (middle - low) / (high - low)
    return cells[numpy.logical_and(place >= part[0], place <= part[1])]


def surface_actor(points, cells, has_edges):
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    mapper = vtkPolyDataMapper()
    mapper.SetInputData(poly_data(points, cells))
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(*COLOUR)
    actor.GetProperty().SetInterpolationToFlat()
    actor.GetProperty().SetAmbient(0.1)
    actor.GetProperty().SetDiffuse(0.9)
    if has_edges:
        actor.GetProperty().EdgeVisibilityOn()
        actor.GetProperty().SetEdgeColor(0.25, 0.22, 0.18)
    return actor


def section_actor(points, cells, origin, normal, colour):
    from vtkmodules.vtkCommonDataModel import vtkPlane
    from vtkmodules.vtkFiltersCore import vtkCutter
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    plane = vtkPlane()
    plane.SetOrigin(*origin)
    plane.SetNormal(*normal)
    cutter = vtkCutter()
    cutter.SetInputData(poly_data(points, cells))
    cutter.SetCutFunction(plane)
    mapper = vtkPolyDataMapper()
    mapper.SetInputConnection(cutter.GetOutputPort())
    mapper.ScalarVisibilityOff()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(*colour)
    actor.GetProperty().SetLineWidth(3)
    actor.GetProperty().LightingOff()
    return actor


def bounds_of(points):
    return [bound for a in range(3) for bound in (points[:, a].min(), points[:, a].max())]


def middle_of(bounds):
    return [(bounds[2 * a] + bounds[2 * a + 1]) / 2 for a in range(3)]


def main():
    arguments = parse_arguments()
    for path in arguments.inputs:
        if not os.path.isfile(path):
            sys.exit(f"render_surfaces.py: {path}: no such file")
    normal = direction(arguments.normal)
    width, height = (int(n) for n in arguments.size.split("x"))
    ensure_display()

    import vtkmodules.vtkInteractionStyle  # noqa: F401  (registers factories)
    import vtkmodules.vtkRenderingFreeType  # noqa: F401
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkTextActor

    behind = off_facets(arguments.section) if arguments.section else None
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(width * len(arguments.inputs), height)
    for place, path in enumerate(arguments.inputs):
        points, cells = off_facets(path) if path.endswith(".off") else voxel_faces(path)
        cells = shown(points, cells, arguments.part)
        renderer = vtkRenderer()
        renderer.SetBackground(1, 1, 1)
        renderer.SetViewport(place / len(arguments.inputs), 0,
                             (place + 1) / len(arguments.inputs), 1)
        if behind:
            bounds = bounds_of(behind[0])
            for surface, colour in ((behind, LINE_BEHIND), ((points, cells), LINE)):
                renderer.AddActor(section_actor(*surface, middle_of(bounds), normal, colour))
        else:
            bounds = bounds_of(points[cells.ravel()])
            renderer.AddActor(surface_actor(points, cells,
                                            arguments.edges and path.endswith(".off")))
        if place < len(arguments.captions):
            text = vtkTextActor()
            text.SetInput(arguments.captions[place])
            text.GetTextProperty().SetColor(0, 0, 0)
            text.GetTextProperty().SetFontSize(20)
            text.SetPosition(10, 8)
            renderer.AddActor(text)
        centre = middle_of(bounds)
        camera = renderer.GetActiveCamera()
        camera.SetFocalPoint(*centre)
        camera.SetPosition(*(centre[a] + normal[a] for a in range(3)))
        camera.SetViewUp(*((0, 0, 1) if abs(normal[2]) < 0.9 else (0, 1, 0)))
        camera.Azimuth(arguments.turn)
        camera.Elevation(arguments.lift)
        camera.OrthogonalizeViewUp()
        fit(renderer, camera, bounds, width / height)
        window.AddRenderer(renderer)
    write_png(window, arguments.image)
    print(f"{arguments.image}: {len(arguments.inputs)} surfaces")


if __name__ == "__main__":
    main()
