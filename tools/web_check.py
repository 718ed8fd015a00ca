#!/usr/bin/env python3
"""The page of `tvc web` in a real headless Chromium, against the virtual rig: load time, fifty updates a
second for a minute without growing memory and with an idle main thread, STOP among seven tabs, a parameter,
step tests compared, charts that are paused and zoomed, 400 px, the console, axe, screenshots.

    pip install websockets
    cargo build -p ground
    python tools/web_check.py --tvc target/debug/tvc --shots shots
    npm pack axe-core    # and --axe with its package/axe.min.js checks accessibility

Needs Chromium. Prints one JSON object; exit status 1 if a requirement is missed.
"""

import argparse
import base64
import contextlib
import itertools
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

from websockets.sync.client import connect

PATIENCE_S = 60
STOPS = 10


class Browser:
    """One page, driven over the DevTools protocol."""

    def __init__(self, program, folder):
        self.process = subprocess.Popen(
            [program, "--headless", "--no-sandbox", "--remote-debugging-port=0", "--window-size=1280,1300",
             f"--user-data-dir={folder}", "about:blank"],
            stderr=subprocess.PIPE, text=True)
        found = next(filter(None, (re.search(r"ws://([^/]+)/", line) for line in self.process.stderr)))
        self.ids = itertools.count(1)
        self.stack = contextlib.ExitStack()
        self.socket = self.stack.enter_context(connect(found.string[found.start():].strip(), max_size=None))
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Performance", "Log"):
            self.send(f"{domain}.enable")

    session = None
    complaints = ()

    def send(self, method, **params):
        number = next(self.ids)
        message = {"id": number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        self.socket.send(json.dumps(message))
        while True:
            answer = json.loads(self.socket.recv(timeout=PATIENCE_S))
            self.listen(answer)
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]

    def listen(self, event):
        """Keeps what the console of this page says: exceptions, and what the policy forbids."""
        params = event.get("params", {})
        if event.get("sessionId") != self.session:
            return
        if event.get("method") == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.complaints += (details.get("exception", details).get("description", details["text"]),)
        if event.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.complaints += (params["entry"]["text"],)

    def value(self, expression):
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def wait(self, expression, seconds=PATIENCE_S):
        end = time.monotonic() + seconds
        while not self.value(expression):
            if time.monotonic() > end:
                raise TimeoutError(expression)
            time.sleep(0.05)

    def memory(self):
        """Bytes in use after a collection, and nodes of the page."""
        self.send("HeapProfiler.collectGarbage")
        metrics = {m["name"]: m["value"] for m in self.send("Performance.getMetrics")["metrics"]}
        return {"heap_bytes": int(metrics["JSHeapUsedSize"]), "nodes": int(metrics["Nodes"])}

    def main_thread(self):
        """Time that the main thread of the busiest page has had, s, by the system's own count."""
        families = {self.process.pid: None}
        for stat in sorted(pathlib.Path("/proc").glob("[0-9]*/stat"), key=lambda path: int(path.parent.name)):
            with contextlib.suppress(OSError):
                fields = stat.read_text().rpartition(")")[2].split()
                if int(fields[1]) in families:
                    is_page = "--type=renderer" in (stat.parent / "cmdline").read_text()
                    thread = (stat.parent / "task" / stat.parent.name / "stat").read_text().rpartition(")")[2].split()
                    families[int(stat.parent.name)] = is_page and (int(thread[11]) + int(thread[12])) / os.sysconf("SC_CLK_TCK")
        return max(filter(None, families.values()))

    def axe(self, script):
        """What axe finds: rule and places."""
        self.value(f"{script};1")
        return self.value("axe.run({resultTypes: ['violations']}).then((all) => "
                          "all.violations.map(({ id, nodes }) => [id, nodes.map(({ target }) => target.join(' '))]))")

    def click(self, selector):
        box = self.value(f"(() => {{ const b = document.querySelector({selector!r}); b.scrollIntoView({{block: 'center'}});"
                         "const r = b.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()")
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=box[0], y=box[1], button="left", clickCount=1)

    def shot(self, path):
        data = self.send("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))

    def end(self):
        self.stack.close()
        self.process.terminate()
        self.process.wait()


def start(*command):
    """Starts a program; its process and the first line that it prints."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return process, process.stdout.readline().strip()


def state(name):
    return f"document.getElementById('state').textContent === '{name}'"


def resident(process):
    pages = pathlib.Path(f"/proc/{process.pid}/statm").read_text().split()[1]
    return int(pages) * 4096


def load(browser, url):
    # The same address again, with its token behind #, would not be loaded anew.
    browser.send("Page.navigate", url="about:blank")
    browser.send("Page.navigate", url=url)
    browser.wait("document.readyState === 'complete' && Number(document.body?.dataset.frames) > 0")
    return browser.value("performance.getEntriesByType('navigation')[0].loadEventEnd")


def updates(browser, web, seconds):
    time.sleep(25)  # The charts' buffers fill up first.
    count = "[Number(document.body.dataset.frames), performance.now()]"
    before, resident_before = browser.memory(), resident(web)
    busy = browser.main_thread()
    first, begun = browser.value(count)
    time.sleep(seconds)
    last, ended = browser.value(count)
    busy = browser.main_thread() - busy
    after = browser.memory()
    return {
        "updates_hz": (last - first) / (ended - begun) * 1e3,
        "seconds": (ended - begun) * 1e-3,
        "main_thread_pct": 100 * busy / ((ended - begun) * 1e-3),
        "page_before": before, "page_after": after,
        "program_bytes_before": resident_before, "program_bytes_after": resident(web),
    }


def stops(browser):
    """From the press to the state on the page, ms."""
    browser.value("""
        window.pressed = 0; window.stopped = 0;
        document.addEventListener('pointerdown', (e) => { if (e.target.id === 'stop') { pressed = performance.now(); stopped = 0; } }, true);
        document.addEventListener('keydown', (e) => { if (e.key === 'Escape') { pressed = performance.now(); stopped = 0; } }, true);
        new MutationObserver(() => { if (document.getElementById('state').textContent === 'standby') stopped ||= performance.now(); })
            .observe(document.getElementById('state'), { childList: true, characterData: true, subtree: true });""")
    times = []
    for turn in range(STOPS):
        browser.wait("document.getElementById('arming').textContent === 'Ready to be armed.'")
        browser.click("[data-order=arm]")
        browser.wait(state("armed"))
        time.sleep(0.3)
        browser.value("window.stopped = 0")
        if turn % 2:
            for kind in ("keyDown", "keyUp"):
                browser.send("Input.dispatchKeyEvent", type=kind, key="Escape", code="Escape", windowsVirtualKeyCode=27)
        else:
            browser.click("#stop")
        browser.wait("window.stopped > 0")
        times.append(browser.value("stopped - pressed"))
    return times


def set_parameter(browser, name, value):
    """What the page shows after a change: value and refusal."""
    field = f"document.querySelector('[aria-label={name}]')"
    browser.value(f"{field}.value = '{value}'; {field}.dispatchEvent(new Event('change'))")
    time.sleep(1)
    return browser.value(f"[Number({field}.value), {field}.nextSibling.textContent]")


def step_test(browser):
    """Figures of a step test, once its release stands in the table."""
    rows = "document.querySelectorAll('#release_table tbody tr').length"
    before = browser.value(rows)
    browser.wait("!document.getElementById('step').disabled")
    browser.click("#step")
    browser.wait(f"{rows} > {before}")
    browser.wait("document.querySelectorAll('#figures div').length > 0")
    return browser.value("document.getElementById('figures').innerText.replace(/\\n/g, ' ')")


def charts(browser):
    """A chart with the cursor on it, paused, and zoomed by dragging: what it says, and how its axis changes."""
    browser.click("[data-chart=pause]")
    box = browser.value("(() => { const r = document.querySelector('#strips .u-over').getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()")
    at = lambda share: {"x": box[0] + share * box[2], "y": box[1] + box[3] / 2}
    words = "document.querySelector('#strips figcaption b').textContent"
    # The pointer's new place is in the next picture but one.
    drawn = lambda: browser.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 300))))")
    browser.send("Input.dispatchMouseEvent", type="mouseMoved", **at(0.5))
    drawn()
    first = browser.value(words)
    time.sleep(1)
    result = {"cursor": first, "stays": browser.value(words) == first}
    browser.send("Input.dispatchMouseEvent", type="mousePressed", button="left", clickCount=1, **at(0.4))
    browser.send("Input.dispatchMouseEvent", type="mouseMoved", button="left", **at(0.6))
    browser.send("Input.dispatchMouseEvent", type="mouseReleased", button="left", clickCount=1, **at(0.6))
    drawn()
    seconds = lambda: float(re.match(r"at ([\d.]+) s", browser.value(words))[1])
    ends = []
    for share in (0.1, 0.9):
        browser.send("Input.dispatchMouseEvent", type="mouseMoved", **at(share))
        drawn()
        ends.append(seconds())
    result["zoomed_s"] = ends[1] - ends[0]
    browser.click("[data-chart=pause]")
    browser.send("Input.dispatchMouseEvent", type="mouseMoved", x=1, y=1)
    drawn()
    result["live"] = browser.value(words)
    return result


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--tvc", default="target/debug/tvc")
    options.add_argument("--chromium", default="chromium")
    options.add_argument("--seconds", type=float, default=60)
    options.add_argument("--shots", type=pathlib.Path, help="folder for screenshots")
    options.add_argument("--axe", type=pathlib.Path, help="axe.min.js of the npm package axe-core")
    options = options.parse_args()
    shots = options.shots
    if shots:
        shots.mkdir(parents=True, exist_ok=True)
    running = []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        port = f"{folder}/nano"
        browser = None
        try:
            running.append(start(options.tvc, "rig", "--pty", "--tilt", "0.3", "--link", port)[0])
            web, url = start(options.tvc, "web", "--port", port, "--listen", "127.0.0.1:0", "--logs", folder)
            running.append(web)
            browser = Browser(options.chromium, f"{folder}/profile")
            result = {"load_ms": [load(browser, url) for _ in range(5)]}
            browser.wait(state("standby"))
            browser.wait("document.querySelector('[aria-label=PID_KP]') !== null")
            result |= updates(browser, web, options.seconds)
            result["stop_ms"] = stops(browser)
            # A browser has six connections for a host, and none of them is held by a page.
            tabs = [browser.send("Target.createTarget", url=url, background=True)["targetId"] for _ in range(6)]
            result["stop_ms_of_seven_tabs"] = stops(browser)
            for tab in tabs:
                browser.send("Target.closeTarget", targetId=tab)
            result["set"] = set_parameter(browser, "PID_KP", 1.25)
            result["refused"] = set_parameter(browser, "PID_KP", 11)
            set_parameter(browser, "PID_KP", 1)
            result["step"] = step_test(browser)
            set_parameter(browser, "PID_KP", 1.4)
            result["second_step"] = step_test(browser)
            result["releases"] = browser.value("document.querySelector('#release_table tbody').innerText.replace(/\\s+/g, ' ')")
            result["charts"] = charts(browser)
            axe = options.axe and options.axe.read_text()
            result["axe"] = {}
            browser.value("scrollTo(0, 0)")
            for size, width in (("wide", 1280), ("phone", 400)):
                phone = size == "phone"
                browser.send("Emulation.setDeviceMetricsOverride", width=width, height=844 if phone else 1300,
                             deviceScaleFactor=1, mobile=phone)
                if phone:
                    load(browser, url)
                    browser.wait(state("standby"))
                for scheme in ("light", "dark"):
                    browser.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
                    time.sleep(0.5)
                    if shots:
                        browser.shot(shots / f"{size}_{scheme}.png")
                    if axe:
                        result["axe"][f"{size} {scheme}"] = browser.axe(axe)
            result["phone_px"] = browser.value("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
            # Nothing is left over at the right when everything is open either.
            browser.value("for (const fold of document.querySelectorAll('h2 .fold[aria-expanded=false]')) fold.click()")
            result["phone_open_px"] = browser.value("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
            if axe:
                result["axe"]["phone, all open"] = browser.axe(axe)
            browser.send("Emulation.clearDeviceMetricsOverride")
            result["console"] = list(browser.complaints)
            set_parameter(browser, "PID_KP", 1.25)
            running[0].terminate()
            browser.wait("document.getElementById('problem').textContent !== ''")
            result["vanished"] = browser.value("document.getElementById('problem').textContent")
            if shots:
                browser.shot(shots / "vanished.png")
            running.append(start(options.tvc, "rig", "--pty", "--tilt", "0.3", "--link", port)[0])
            browser.wait(state("standby"))
            set_parameter(browser, "PID_KP", 1.5)
            web.terminate()
            web.wait()
            got = subprocess.run([options.tvc, "param", "get", "PID_KP", "--json", "--port", port],
                                 capture_output=True, text=True, check=True)
            result["image_has"] = json.loads(got.stdout)["parameters"][0]["value"]
        finally:
            if browser:
                browser.end()
            for process in running:
                process.terminate()
                process.wait()
    growth = result["page_after"]["heap_bytes"] - result["page_before"]["heap_bytes"]
    result["met"] = {
        "loads in under a second": max(result["load_ms"]) < 1000,
        "50 updates a second": result["updates_hz"] > 49,
        "memory does not grow": growth < 200_000 and result["page_after"]["nodes"] <= result["page_before"]["nodes"] + 50,
        "STOP within 100 ms": max(result["stop_ms"]) < 100,
        "STOP among seven tabs that all draw": max(result["stop_ms_of_seven_tabs"]) < 1000,
        "a parameter reaches the image": result["set"] == [1.25, ""] and result["image_has"] == 1.5,
        "a refusal is shown": result["refused"][0] == 1.25 and "must be 0 to 10" in result["refused"][1],
        "the main thread is idle for three quarters": result["main_thread_pct"] < 25,
        "releases are compared": "PID_KP 1 → 1.4" in result["releases"],
        "charts stay where they are paused": result["charts"]["stays"] and result["charts"]["cursor"].startswith("at "),
        "charts zoom": 1 < result["charts"]["zoomed_s"] < 5 and not result["charts"]["live"].startswith("at "),
        "400 px are enough": result["phone_px"][0] <= 400 and result["phone_px"][1] < 2500 and result["phone_open_px"][0] <= 400,
        "axe finds nothing, or was not asked": not any(result["axe"].values()),
        "the console is silent": result["console"] == [],
    }
    result["stop_ms_median"] = statistics.median(result["stop_ms"])
    print(json.dumps(result, indent=2))
    return 0 if all(result["met"].values()) else 1


if __name__ == "__main__":
    sys.exit(main())
