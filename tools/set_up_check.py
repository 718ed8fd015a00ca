#!/usr/bin/env python3
"""From a Nano out of its box to a release and its report, in the page of `tvc web` alone: a real headless
Chromium at the virtual rig, once 1280 and once 400 pixels wide, with screenshots.

    pip install websockets
    cargo build -p ground
    python tools/set_up_check.py --tvc target/debug/tvc --shots shots

Needs Chromium. Prints how each step ended; exit status 1 if one is not met or the page is wider than its window.
"""

import argparse
import json
import pathlib
import sys
import tempfile
import time

from web_check import Browser, load, start, state

PATIENCE_S = 300
#: Buttons of a new question take no click for 0.4 s.
PAUSE_S = 0.5

GUIDE = "document.querySelector('#set-up .guide')"


def ask(browser, words):
    """Waits for a question."""
    browser.wait(f"!{GUIDE}.querySelector('.question').hidden"
                 f" && {GUIDE}.querySelector('.asked').textContent.includes({json.dumps(words)})", PATIENCE_S)
    time.sleep(PAUSE_S)


def press(browser, label):
    """Presses a button of the question."""
    browser.value(f"[...{GUIDE}.querySelectorAll('.replies button')]"
                  f".find((button) => button.textContent === {json.dumps(label)}).click()")


def enter(browser, text):
    """Types an answer."""
    browser.value(f"{GUIDE}.querySelector('.typed').value = {json.dumps(text)};"
                  f"{GUIDE}.querySelector('.entry').requestSubmit()")


def answer(browser, *answers):
    for words, label in answers:
        ask(browser, words)
        press(browser, label)


def begin(browser, step):
    button = f"[data-step={step}]"
    browser.wait(f"!document.querySelector('{button}').disabled", PATIENCE_S)
    browser.click(button)


def end(browser):
    """What became of the step."""
    ending = f"{GUIDE}.querySelector('.ending')"
    browser.wait(f"{GUIDE}.querySelector('.cancel').hidden && {ending}.textContent !== ''", PATIENCE_S)
    return browser.value(f"[{ending}.textContent, {ending}.classList.contains('met')]")


def walk(browser, url, shot):
    """The whole way; what became of each step."""
    load(browser, url)
    endings = {}
    begin(browser, "sensors")
    ask(browser, "Magnetic declination")
    enter(browser, "55.79,12.52")
    browser.wait(f"!{GUIDE}.querySelector('.seen').hidden", PATIENCE_S)
    shot("turn")
    answer(browser, ("stand level", "It stands level"))
    ask(browser, "Write this")
    shot("sensors")
    press(browser, "Yes")
    endings["sensors"] = end(browser)
    begin(browser, "servo")
    ask(browser, "hangs straight down")
    enter(browser, "1523.6")
    time.sleep(PAUSE_S)
    shot("servo")
    answer(browser, ("hangs straight down", "It is so"), ("how many deg", "Leave the scale as it is"),
           ("to the nose", "Leave it as it is"), ("Shortest", "It is so"), ("Longest", "It is so"), ("Write this", "Yes"))
    endings["servo"] = end(browser)
    begin(browser, "polarity")
    ask(browser, "point forward")
    shot("polarity")
    answer(browser, ("point forward", "Yes"), ("point backward", "Yes"))
    endings["polarity"] = end(browser)
    begin(browser, "hold")
    browser.wait(state("active"), PATIENCE_S)
    shot("hold")
    answer(browser, ("Write this", "Yes"))
    endings["hold"] = end(browser)
    browser.wait("!document.getElementById('step').disabled", PATIENCE_S)
    browser.value("document.getElementById('step').click()")
    browser.wait("document.querySelectorAll('#figures div').length > 0", PATIENCE_S)
    shot("released")
    missed = browser.value("document.getElementById('missed').innerText")
    endings["release"] = [missed or "every requirement met", missed == ""]
    report = "[...document.querySelectorAll('#logs button')].find((button) => button.title.includes('report of step-'))"
    # On a small screen the list is folded.
    browser.value("document.querySelector('#logs.closed .fold')?.click()")
    browser.wait(f"{report} !== undefined")
    browser.value(f"{report}.click()")
    browser.wait("!document.getElementById('report').hidden")
    browser.value("document.getElementById('report').scrollIntoView()")
    shot("report", scroll=False)
    return endings


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--tvc", default="target/debug/tvc")
    options.add_argument("--chromium", default="chromium")
    options.add_argument("--shots", type=pathlib.Path, help="folder for screenshots")
    options = options.parse_args()
    if options.shots:
        options.shots.mkdir(parents=True, exist_ok=True)
    result = {}
    for width in (1280, 400):
        wide = []
        running = []
        browser = None
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            port = f"{folder}/nano"
            rig = ("--blank", "--sensor-errors", "worst", "--cm-offset", "5", "--speed", "2", "--tilt", "0.3")
            try:
                running.append(start(options.tvc, "rig", "--pty", "--link", port, *rig)[0])
                web, url = start(options.tvc, "web", "--port", port, "--listen", "127.0.0.1:0", "--logs", folder)
                running.append(web)
                browser = Browser(options.chromium, f"{folder}/profile")
                browser.send("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)

                def shot(name, scroll=True):
                    if scroll:
                        browser.value("scrollTo(0, 0)")
                    if browser.value("document.documentElement.scrollWidth > innerWidth"):
                        wide.append(name)
                    if options.shots:
                        browser.shot(options.shots / f"{name}-{width}.png")

                endings = walk(browser, url, shot)
            finally:
                if browser:
                    browser.end()
                for process in running:
                    process.terminate()
                    process.wait()
        result[width] = {"endings": endings, "wider_than_the_window": wide,
                         "met": not wide and all(met for _, met in endings.values())}
    print(json.dumps(result, indent=2))
    return 0 if all(one["met"] for one in result.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
