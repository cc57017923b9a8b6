#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Checks the container recipe as far as that goes without a container: what it copies is all that
configuring, building and installing read; its commands parse; its packages are in Debian. A test
(label "slow").

    test_container.py SOURCE OUT

Building the image takes a registry with debian:bookworm, half a GB of packages, and a full build.
"""

import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys


def check(what, is_true):
    print(("ok:     " if is_true else "FAILED: ") + what, flush=True)
    return is_true


def instructions(path):
    """Pairs of keyword and text, with continued lines joined and comments taken out."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    text = "\n".join(lines).replace("\\\n", " ")
    return [tuple(line.split(None, 1)) for line in text.splitlines() if line.strip()]


def copy_sources(recipe, source, tree):
    """Does what the COPY lines of the first stage do, into the folder `tree`."""
    for keyword, text in recipe:
        words = shlex.split(text)
        if keyword != "COPY" or words[0].startswith("--from"):
            continue
        for word in words[:-1]:
            origin = source / word
            if origin.is_dir():
                shutil.copytree(origin, tree / words[-1])
            else:
                shutil.copy(origin, tree / words[-1])


def run(*command, **options):
    return subprocess.run([str(word) for word in command], text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, check=False, **options)


def configure_line(recipe):
    """The recipe's own call of cmake that configures."""
    commands = [part for keyword, text in recipe if keyword == "RUN" for part in text.split("&&")]
    return next(shlex.split(part) for part in commands if part.split()[:2] == ["cmake", "-S"])


def check_sources(recipe, tree, build):
    line = [str(build) if word == "/build" else word for word in configure_line(recipe)]
    configured = run(*line, cwd=tree)
    if not check("what is copied configures", configured.returncode == 0):
        print(configured.stdout)
        return False
    # Ninja looks for every source, without building.
    planned = run("ninja", "-C", build, "-n")
    if not check("what is copied has every source", planned.returncode == 0):
        print(planned.stdout[-2000:])
        return False
    texts = "".join(path.read_text() for path in build.rglob("cmake_install.cmake"))
    origins = set(re.findall(f'"({re.escape(str(tree))}/[^"]+)"', texts))
    missing = [origin for origin in origins if not pathlib.Path(origin).exists()]
    return check(f"what is copied has what is installed: {missing}", bool(origins) and not missing)


def packages_of_script(tree, out):
    """What install_dependencies.sh would install where nothing is there yet."""
    stubs = out / "stubs"
    stubs.mkdir()
    for name, text in {"dpkg-query": "exit 1", "id": "echo 0", "apt-get": "exit 0"}.items():
        (stubs / name).write_text(f"#!/bin/sh\n{text}\n")
        (stubs / name).chmod(0o755)
    environment = {**os.environ, "PATH": f"{stubs}:{os.environ['PATH']}"}
    said = run(tree / "scripts" / "install_dependencies.sh", "--no-tests", env=environment).stdout
    return re.search(r"^installing:(.*)$", said, re.MULTILINE).group(1).split()


def check_packages(recipe, tree, out):
    commands = [part for keyword, text in recipe if keyword == "RUN" for part in text.split("&&")]
    names = packages_of_script(tree, out)
    for part in commands:
        words = shlex.split(part)
        if words[:2] == ["apt-get", "install"]:
            names += [word for word in words[2:] if word[0] not in "-/"]
    if shutil.which("apt-cache") is None or run("apt-cache", "show", "cmake").returncode != 0:
        print("packages not looked for: no lists of Debian's packages here")
        return True
    absent = [name for name in names if run("apt-cache", "show", name).returncode != 0]
    return check(f"{len(names)} packages are in Debian: {absent}", len(names) > 10 and not absent)


def main():
    source, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    shutil.rmtree(out, ignore_errors=True)
    tree, build = out / "source", out / "build"
    tree.mkdir(parents=True)
    recipe = instructions(source / "scripts" / "packaging" / "Containerfile")
    keywords = [keyword for keyword, _ in recipe]
    parses = [run("sh", "-n", "-c", text).returncode == 0 for keyword, text in recipe
              if keyword == "RUN"]
    copy_sources(recipe, source, tree)
    results = [
        check("stages, commands and an entry point",
              set(keywords) == {"FROM", "WORKDIR", "COPY", "RUN", "ENTRYPOINT"}),
        check(f"{len(parses)} commands parse", bool(parses) and all(parses)),
        check("every stage is Debian's", all(text.startswith("debian:bookworm")
                                             for keyword, text in recipe if keyword == "FROM")),
        check_sources(recipe, tree, build),
        check_packages(recipe, tree, out),
    ]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
