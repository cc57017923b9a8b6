#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Checks the Boutiques descriptor: against the rules of its format (schema 0.5), against the options
that cvmesh knows, and by running the command lines that Boutiques would make of it. A test (label
"slow").

    test_boutiques.py CVMESH DESCRIPTOR OUT

Exits with 77 (skipped) where nibabel is not installed.
"""

import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys

SKIPPED = 77
try:
    import nibabel
    import numpy as np
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(SKIPPED)

REQUIRED = {"name", "description", "command-line", "schema-version", "inputs", "tool-version"}
IN_BOTH = {"id", "name", "description", "value-key", "list", "optional", "command-line-flag",
           "command-line-flag-separator", "uses-absolute-path"}
OF_INPUTS = IN_BOTH | {"type", "list-separator", "value-choices", "integer", "minimum",
                       "exclusive-minimum"}
OF_OUTPUTS = IN_BOTH | {"path-template"}
# Boutiques has an output of its own for what cvmesh says.
LEFT_OUT = {"--help", "--quiet", "--verbose"}


def check(what, is_true):
    print(("ok:     " if is_true else "FAILED: ") + what, flush=True)
    return is_true


def follows_format(descriptor):
    inputs, outputs = descriptor["inputs"], descriptor["output-files"]
    ids = [entry["id"] for entry in inputs + outputs]
    keys = [entry["value-key"] for entry in inputs]
    flags = [entry for entry in inputs if entry["type"] == "Flag"]
    container = descriptor["container-image"]
    return all([
        check("all keys that are needed", REQUIRED <= descriptor.keys()),
        check("version of the schema", descriptor["schema-version"] == "0.5"),
        check("ids: one each, of letters, digits and underscores",
              len(set(ids)) == len(ids) and all(re.fullmatch(r"\w+", one) for one in ids)),
        check("no unknown properties", all(entry.keys() <= OF_INPUTS for entry in inputs) and
              all(entry.keys() <= OF_OUTPUTS for entry in outputs)),
        check("types", {entry["type"] for entry in inputs} <= {"String", "File", "Flag", "Number"}),
        check("every value key is in the command line, once",
              all(descriptor["command-line"].count(key) == 1 for key in keys)),
        check("no value key contains another",
              not any(a != b and a in b for a in keys for b in keys)),
        check("flags are optional, and have a flag",
              all(entry["optional"] and "command-line-flag" in entry for entry in flags)),
        check("the container's image is of this version",
              container == {"type": "docker", "image": f"cvmesh:{descriptor['tool-version']}"}),
    ])


def knows_options(cvmesh, descriptor):
    help_text = subprocess.run([cvmesh, "mesh", "--help"], check=True, text=True,
                               stdout=subprocess.PIPE).stdout
    version = subprocess.run([cvmesh, "--version"], check=True, text=True,
                             stdout=subprocess.PIPE).stdout.split()[-1]
    options = set(re.findall(r"--[a-z][a-z-]*", help_text)) - LEFT_OUT
    flags = {entry["command-line-flag"] for entry in descriptor["inputs"]
             if "command-line-flag" in entry} | {"--out"}
    space = next(entry for entry in descriptor["inputs"] if entry["id"] == "space")
    choices = re.search(r"--space TEXT:\{([a-z,]+)\}", help_text).group(1).split(",")
    return all([
        check(f"version {version}", descriptor["tool-version"] == version),
        check(f"every option is an input: {sorted(options ^ flags)}", options == flags),
        check("every space is a choice", sorted(space["value-choices"]) == sorted(choices)),
    ])


def command_line(descriptor, values):
    """As Boutiques makes it: values quoted, lists joined, keys without a value taken out."""
    line = descriptor["command-line"]
    for entry in descriptor["inputs"]:
        key, name = entry["value-key"], entry["id"]
        if name not in values:
            line = line.replace(" " + key, "")
            continue
        value, flag = values[name], entry.get("command-line-flag", "")
        if entry["type"] == "Flag":
            text = flag
        else:
            parts = value if entry.get("list") else [value]
            text = entry.get("list-separator", " ").join(shlex.quote(str(part)) for part in parts)
            text = (flag + " " + text).strip()
        line = line.replace(key, text)
    return line


def make_images(out):
    x = np.indices((18, 17, 16)).transpose(1, 2, 3, 0)
    ball = (((x - (8.5, 8, 7.5)) / 6) ** 2).sum(axis=3) < 1
    labels = (ball * np.where(x[..., 0] > 8, 2, 1)).astype(np.uint8)
    both = np.stack([np.zeros_like(labels), labels], axis=3)
    nibabel.save(nibabel.Nifti1Image(labels, np.eye(4)), out / "a volume's.nii.gz")
    nibabel.save(nibabel.Nifti1Image(both, np.eye(4)), out / "both.nii.gz")
    nibabel.save(nibabel.Nifti1Image(x[..., 2].astype(np.float32), np.eye(4)), out / "ct.nii.gz")
    (out / "params.json").write_text('{"epsilon": 3, "delta": 0.3}')
    (out / "names.label").write_text('    1  255 0 0  1  1 1  "Soft tissue"\n'
                                     '    2  0 255 0  1  1 1  "Bone"\n')


def invocations():
    """Name, inputs, exit code, files that must be there."""
    least = {"labels": "a volume's.nii.gz", "out": "the least"}
    full = {"labels": "both.nii.gz", "out": "all of it", "params": "params.json",
            "settings": ["epsilon=1.5", "labels.2.max_edge_mm=3"], "seed": 7,
            "label_names": "names.label", "sample": "ct.nii.gz", "volume": 1, "allow_shear": True,
            "allow_detached": True, "formats": "vtu,inp", "space": "lps", "report": True,
            "keep_stages": True, "threads": 1, "time_limit": 600, "memory_limit": 4000,
            "resume": True, "force": True}
    surface = {"labels": "a volume's.nii.gz", "out": "surface", "surface_only": True}
    return [
        ("the inputs that are needed", least, 0, ["a volume's.vtu", "a volume's.mesh"]),
        ("results that are there", least, 6, []),
        ("every input", full, 0, ["both.vtu", "both.inp", "both.report.html", "both.stages"]),
        ("the surface only", surface, 0, ["a volume's.surface.vtp"]),
        ("no volume", {**least, "labels": "params.json"}, 3, []),
    ]


def runs(cvmesh, descriptor, out):
    environment = {**os.environ, "PATH": f"{cvmesh.parent}:{os.environ['PATH']}"}
    codes = {0} | {entry["code"] for entry in descriptor["error-codes"]}
    template = descriptor["output-files"][0]["path-template"]
    used, well = set(), True
    for name, values, code, files in invocations():
        used |= values.keys()
        line = command_line(descriptor, values)
        print(line)
        done = subprocess.run(line, shell=True, cwd=out, env=environment, text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        folder = out / template.replace("[OUT]", values["out"])
        is_right = done.returncode == code and all((folder / file).exists() for file in files)
        well &= check(f"{name}: exit code {done.returncode}", is_right and code in codes)
        if not is_right:
            print(done.stdout)
    report = json.loads((out / "all of it" / "both.metrics.json").read_text())
    parameters = report["parameters"]
    labels = [(entry["label"], entry["name"]) for entry in report["results"]["labels"]]
    return all([
        well,
        check("every input was tried", used == {entry["id"] for entry in descriptor["inputs"]}),
        check("lists and numbers arrived",
              (parameters["epsilon"], parameters["delta"], parameters["seed"]) == (1.5, 0.3, 7)),
        check(f"names arrived: {labels}", labels == [(1, "Soft tissue"), (2, "Bone")]),
    ])


def main():
    cvmesh, path, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    make_images(out)
    descriptor = json.loads(path.read_text())
    results = [follows_format(descriptor), knows_options(cvmesh, descriptor),
               runs(cvmesh, descriptor, out)]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
