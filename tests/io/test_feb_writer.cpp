// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/feb_writer.h"
#include "cvmesh/tet/split_contacts.h"

#include "io/image_files.h"
#include "io/writer_meshes.h"
#include "support/catch.h"
#include "support/test_data.h"

using namespace cvmesh;
using namespace cvmesh::image_files;
using namespace cvmesh::writer_meshes;

namespace {

/// Reads a file by the structure that the user manual of FEBio 4 publishes: sections in order, each
/// domain an Elements part with a material, every id once. Arguments: the file, whether it is of
/// second order, whether the interface is cut.
constexpr char kCheck[] = R"py(
import sys, xml.etree.ElementTree as tree
path, is_second_order, is_cut = sys.argv[1], sys.argv[2] == "1", sys.argv[3] == "1"
text = open(path, encoding="utf-8").read()
assert "SPACE=LPS" in text and "cvmesh: mesh for FEBio" in text[:200]
root = tree.fromstring(text.encode())
assert root.tag == "febio_spec" and root.attrib == {"version": "4.0"}
assert [child.tag for child in root] == ["Module", "Material", "Mesh", "MeshDomains"]
assert root.find("Module").attrib == {"type": "solid"}
materials = {}
for number, material in enumerate(root.find("Material"), 1):
    assert material.attrib["id"] == str(number) and material.attrib["type"] == "neo-Hookean"
    assert [child.tag for child in material] == ["density", "E", "v"]
    materials[material.attrib["name"]] = material
mesh = root.find("Mesh")
order = [child.tag for child in mesh]
assert order == sorted(order, key=["Nodes", "Elements", "NodeSet", "Surface",
                                   "SurfacePair"].index), order
nodes = {}
for node in mesh.find("Nodes"):
    assert node.tag == "node"
    nodes[int(node.attrib["id"])] = [float(x) for x in node.text.split(",")]
assert sorted(nodes) == list(range(1, len(nodes) + 1))
def volume6(a, b, c, d):
    u, v, w = ([q[k] - a[k] for k in range(3)] for q in (b, c, d))
    return sum(w[k] * (u[k - 2] * v[k - 1] - u[k - 1] * v[k - 2]) for k in range(3))
edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
parts, ids, volumes = {}, [], {}
for part in mesh.findall("Elements"):
    name = part.attrib["name"]
    assert part.attrib["type"] == ("tet10" if is_second_order else "tet4")
    for elem in part:
        n = [int(x) for x in elem.text.split(",")]
        assert elem.tag == "elem" and len(n) == (10 if is_second_order else 4)
        ids.append(int(elem.attrib["id"]))
        p = [nodes[i] for i in n]
        assert volume6(*p[:4]) > 0
        volumes[name] = volumes.get(name, 0) + volume6(*p[:4])
        parts.setdefault(name, set()).update(n)
        for (a, b), m in zip(edges, p[4:]):
            assert all(abs(m[k] - (p[a][k] + p[b][k]) / 2) < 1e-12 for k in range(3))
assert sorted(ids) == list(range(1, 7)), ids
domains = [(d.tag, d.attrib["name"], d.attrib["mat"]) for d in root.find("MeshDomains")]
assert [d[1] for d in domains] == list(parts) == ["SOFT_TISSUE", "BONE"], domains
assert all(d[0] == "SolidDomain" and d[2] in materials for d in domains)
sets = {s.attrib["name"]: [int(x) for x in s.text.split(",")] for s in mesh.findall("NodeSet")}
surfaces, flux = {}, {}
for surface in mesh.findall("Surface"):
    name = surface.attrib["name"]
    for number, face in enumerate(surface, 1):
        n = [int(x) for x in face.text.split(",")]
        assert face.tag == ("tri6" if is_second_order else "tri3")
        assert face.attrib["id"] == str(number)
        surfaces.setdefault(name, []).append(n)
        flux[name] = flux.get(name, 0) + volume6([0, 0, 0], *(nodes[i] for i in n[:3]))
assert list(sets) == list(surfaces)
for name, faces in surfaces.items():
    assert set(sets[name]) == {n for face in faces for n in face}, name
assert abs(flux["BONE_EXTERIOR"] + flux["BONE_SOFT_TISSUE"] - volumes["BONE"]) < 1e-9
pairs = mesh.findall("SurfacePair")
assert len(pairs) == (1 if is_cut else 0)
for pair in pairs:
    inner, outer = pair.find("primary").text, pair.find("secondary").text
    assert (inner, outer) == ("BONE_SOFT_TISSUE", "SOFT_TISSUE_BONE"), (inner, outer)
    assert len(sets[inner]) == len(sets[outer]) and not set(sets[inner]) & set(sets[outer])
    assert all(nodes[a] == nodes[b] for a, b in zip(sets[inner], sets[outer]))
    assert set(sets[inner]) <= parts["BONE"] and set(sets[outer]) <= parts["SOFT_TISSUE"]
    assert not parts["BONE"] & parts["SOFT_TISSUE"]
)py";

}  // namespace

TEST_CASE("write_feb: parts, surfaces, node sets and pairs as FEBio's format has them",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  for (const bool is_second_order : {false, true})
    for (const bool is_mirrored : {false, true})
      for (const bool is_cut : {false, true}) {
        CAPTURE(is_second_order, is_mirrored, is_cut);
        TetMesh mesh = cube(is_second_order);
        if (is_cut) split_contacts(mesh, {{2, 1}});
        write_feb(folder / "a.feb", mesh, named("soft -- <tissue>\n", "bone"), oblique(is_mirrored),
                  Space::Lps);
        const PythonRun run =
            run_python(folder.path(), kCheck,
                       "'" + (folder / "a.feb").string() + "' " + (is_second_order ? "1" : "0") +
                           " " + (is_cut ? "1" : "0"));
        INFO(run.output);
        CHECK(run.ok);
      }
}
