#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Opens an HTML report in headless Chromium, through its driver, and looks at it as a reader would:
no error in the console, no request for anything but the file, tables filled, a picture that
follows its controls, and label names that stay text. A test (label "cli").

    test_html_report.py CVMESH CVMESH_PHANTOM OUT

Exits with 77 (skipped) where Chromium or its driver is not installed.
"""

import base64
import gzip
import json
import pathlib
import shutil
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request

SKIPPED = 77
LOAD_SECONDS = 60  # software rendering on a loaded machine; the figure that counts is printed
HOSTILE = "</script><script>window.intruder = 1</script><b>\u2028bone"
SOFTWARE_WEBGL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# Elements of W3C's driver protocol are objects with this key.
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"


def run(command):
    done = subprocess.run([str(word) for word in command], text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT)
    if done.returncode != 0:
        sys.exit(f"{done.stdout}\n{command[0]} ended with {done.returncode}")


class Browser:
    """A session of headless Chromium."""

    def __init__(self, driver, chromium, arguments=()):
        self.process = subprocess.Popen([driver, "--port=0"], text=True, stdout=subprocess.PIPE)
        # It names the port that it found free in its last line: "... on port 12345."
        line = next(line for line in self.process.stdout if "started successfully" in line)
        self.base = f"http://127.0.0.1:{line.split()[-1].strip('.')}/session"
        options = {"binary": chromium,
                   "args": ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage",
                            "--window-size=1400,1200", *arguments]}
        capabilities = {"browserName": "chrome", "goog:chromeOptions": options,
                        "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"}}
        try:
            answer = self.ask("POST", "", {"capabilities": {"alwaysMatch": capabilities}})
        except BaseException:
            self.process.terminate()
            raise
        self.base += "/" + answer["sessionId"]

    def ask(self, method, path, body=None):
        request = urllib.request.Request(
            self.base + path, method=method, headers={"Content-Type": "application/json"},
            data=None if body is None else json.dumps(body).encode())
        try:
            with urllib.request.urlopen(request, timeout=180) as response:
                return json.load(response)["value"]
        except urllib.error.HTTPError as error:
            sys.exit(f"{path}: {error.read().decode()}")

    def close(self):
        try:
            self.ask("DELETE", "")
        finally:
            self.process.terminate()
            self.process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def open(self, path):
        self.ask("POST", "/url", {"url": path.resolve().as_uri()})

    def script(self, code, *arguments):
        return self.ask("POST", "/execute/sync", {"script": code, "args": list(arguments)})

    def click(self, selector):
        found = self.ask("POST", "/element", {"using": "css selector", "value": selector})
        self.ask("POST", f"/element/{found[ELEMENT]}/click", {})

    def set_value(self, selector, value, event):
        self.script("const e = document.querySelector(arguments[0]); e.value = arguments[1];"
                    "e.dispatchEvent(new Event(arguments[2], {bubbles: true}));",
                    selector, value, event)
        self.wait_for_frame()

    def wait_for_frame(self):
        """The view draws in the next frame; this comes back in the one after it."""
        self.ask("POST", "/execute/async", {"args": [], "script": (
            "const done = arguments[0];"
            "requestAnimationFrame(() => requestAnimationFrame(() => done()));")})

    def wait_for_viewer(self):
        start = time.monotonic()
        while time.monotonic() < start + LOAD_SECONDS:
            state = self.script("return document.documentElement.dataset.viewer || ''")
            if state:
                self.wait_for_frame()
                return state
            time.sleep(0.02)
        sys.exit(f"the view was not there after {LOAD_SECONDS} s")

    def picture(self):
        """The picture in 100 x 60 averaged pixels (r, g, b, a); and its share that is drawn on."""
        pixels = self.script(
            "const flat = document.createElement('canvas'), c = flat.getContext('2d');"
            "flat.width = 100; flat.height = 60;"
            "c.drawImage(document.getElementById('canvas'), 0, 0, 100, 60);"
            "return Array.from(c.getImageData(0, 0, 100, 60).data);")
        return pixels, sum(alpha > 128 for alpha in pixels[3::4]) / 6000

    def console_errors(self):
        return [entry["message"] for entry in self.ask("POST", "/se/log", {"type": "browser"})
                if entry["level"] == "SEVERE"]

    def requests(self):
        """URLs that the page asked for."""
        messages = [json.loads(entry["message"])["message"]
                    for entry in self.ask("POST", "/se/log", {"type": "performance"})]
        return [message["params"]["request"]["url"] for message in messages
                if message["method"] == "Network.requestWillBeSent"]

    def screenshot(self, path):
        path.write_bytes(base64.b64decode(self.ask("GET", "/screenshot")))


def write_sheared(source, path):
    """A copy of a NIfTI volume whose third axis leans towards the first, at voxels of 1 mm."""
    volume = bytearray(gzip.decompress(source.read_bytes()))
    struct.pack_into("<hh", volume, 252, 0, 1)  # the s-form alone
    struct.pack_into("<12f", volume, 280, 1, 0, 0.6, 0, 0, 1, 0, 0, 0, 0, 0.8, 0)
    path.write_bytes(gzip.compress(bytes(volume)))


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")
    print(f"ok: {what}")


def differs(one, other):
    """Whether more than 1 % of the pixels of two pictures differ visibly."""
    return sum(abs(a - b) > 16 for a, b in zip(one, other)) > 0.01 * len(one)


def check_page(browser, page):
    start = time.monotonic()
    browser.open(page)
    check(browser.wait_for_viewer() == "ready", "the 3-D view is there")
    print(f"   {page.stat().st_size / 1e6:.1f} MB, open after {time.monotonic() - start:.1f} s")
    urls = browser.requests()
    check(page.resolve().as_uri() in urls, "the page itself is among the requests that were seen")
    check(all(url.startswith(("file:", "data:", "blob:")) for url in urls), "no network")


def check_texts(browser):
    body = browser.script("return document.body.innerText")
    check("undefined" not in body and "NaN" not in body and "[object" not in body,
          "no figure is missing")
    check("bone" in body and "<script>window.intruder" in body, "the label's name is there, as text")
    check(browser.script("return window.intruder === undefined"), "and was not run as a script")
    # Cells of labels that are in the mesh; distances among them.
    cells = browser.script("return Array.from(document.querySelectorAll('#labels tbody td'),"
                           "cell => cell.textContent)")
    check(len(cells) > 10 and all(cell.strip() not in ("", "–") for cell in cells),
          "every cell of the table of labels is filled")
    for table, least in (("quality", 6), ("distances", 4), ("stages", 10)):
        rows = browser.script(f"return document.querySelectorAll('#{table} tbody tr').length")
        check(rows >= least, f"the table '{table}' has its {rows} rows")
    check(browser.script("return document.querySelectorAll('svg.chart').length") == 4, "four plots")


def check_view(browser):
    first, share = browser.picture()
    check(0.05 < share < 0.95, f"the picture is drawn on to {share:.0%}")
    shown = int(browser.script("return document.getElementById('canvas').dataset.elements"))
    browser.set_value("#cut-at", 300, "input")
    moved, _ = browser.picture()
    check(differs(first, moved), "moving the cut plane changes the picture")
    more = int(browser.script("return document.getElementById('canvas').dataset.elements"))
    check(more > shown > 0, f"and shows {more} tets instead of {shown}")
    browser.click("#cut-on")
    browser.wait_for_frame()
    total = int(browser.script("return document.getElementById('canvas').dataset.elements"))
    check(total > more, f"without the cut all {total} tets are shown")
    for index, quantity in ((1, "quality"), (2, "angle"), (3, "distance")):
        before, _ = browser.picture()
        browser.set_value("#colour-by", index, "change")
        check(differs(before, browser.picture()[0]), f"colours by {quantity}")
    browser.click("#label-list input")
    browser.wait_for_frame()
    fewer = int(browser.script("return document.getElementById('canvas').dataset.elements"))
    check(0 < fewer < total, f"with a label hidden, {fewer} tets are shown")
    browser.click("#labels-none")
    browser.wait_for_frame()
    check(browser.picture()[1] == 0, "with all labels hidden the picture is empty")


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    cvmesh, phantom, out = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
    driver, chromium = shutil.which("chromedriver"), shutil.which("chromium")
    if driver is None or chromium is None:
        print("skipped: chromium or chromium-driver is not installed")
        return SKIPPED
    out.mkdir(parents=True, exist_ok=True)
    run([phantom, "spheres", "--out", out / "spheres.nii.gz"])
    command = [cvmesh, "mesh", out / "spheres.nii.gz", "--out", out, "--report", "--quiet", "--force",
               "--set", f"labels.1.name={HOSTILE}", "--set", "epsilon=0.8"]
    run(command)
    page = out / "spheres.report.html"
    with Browser(driver, chromium, SOFTWARE_WEBGL) as browser:
        check_page(browser, page)
        check_texts(browser)
        check_view(browser)
        check(browser.console_errors() == [], "no error in the console")
        browser.screenshot(out / "spheres.png")
    with Browser(driver, chromium, ["--disable-3d-apis"]) as browser:
        browser.open(page)
        check(browser.wait_for_viewer() == "flat", "without WebGL the page says so")
        check_texts(browser)
        check(browser.console_errors() == [], "and its console stays empty")
    run(command + ["--surface-only"])
    with Browser(driver, chromium, SOFTWARE_WEBGL) as browser:
        browser.open(page)
        check(browser.wait_for_viewer() == "ready", "a report of surfaces only has its view")
        check(browser.picture()[1] > 0.05, "and draws on it")
        check(browser.console_errors() == [], "and its console stays empty")
        page.write_text(page.read_text().replace('"tets_left_out":0', '"tets_left_out":2500000'))
        browser.open(page)
        browser.wait_for_viewer()
        shown = browser.script("return document.getElementById('shown').textContent")
        check("tets are too many" in shown, "it tells where tets were left out")
    write_sheared(out / "spheres.nii.gz", out / "sheared.nii.gz")
    run([cvmesh, "mesh", out / "sheared.nii.gz", "--out", out, "--allow-shear", "--surface-only",
         "--report", "--quiet", "--force"])
    distances = json.loads((out / "sheared.metrics.json").read_text())["results"]["distances"]
    with Browser(driver, chromium, SOFTWARE_WEBGL) as browser:
        browser.open(out / "sheared.report.html")
        browser.wait_for_viewer()
        table = browser.script("return document.getElementById('distances').innerText")
        check("mm in the world" in table, "of a sheared volume distances are those of the world")
        largest = browser.script("return document.querySelector("
                                 "'#distances tbody tr td:last-child').textContent")
        true = distances["to_dense"]["world_mm"]["mesh_to_reference"]["max"]
        check(abs(float(largest) / true - 1) < 0.01, f"the largest is {true:.3g} mm")
        check(browser.console_errors() == [], "and the console stays empty")
    return 0


if __name__ == "__main__":
    sys.exit(main())
