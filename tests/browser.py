"""A headless Chromium for tests of pages: without a network, its console and its requests kept."""

import json
import shutil
import time

import pytest

HOW = "no Chromium here, in which pages are tested: apt-get install chromium chromium-driver"
PATIENCE = 300.0  # [s], of a loaded machine; nothing is timed


def chromium():
    """A driver of it; skips the test where there is none, and says how to get it."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip(HOW)
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = program
    options.page_load_strategy = "none"
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    switches = ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage")
    offline = ("host-resolver-rules=MAP * ~NOTFOUND", "disable-background-networking")
    for switch in (*switches, *offline, "window-size=1280,900", "force-device-scale-factor=1"):
        options.add_argument(f"--{switch}")
    made = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    made.command_executor.client_config.timeout = PATIENCE
    made.set_script_timeout(PATIENCE)
    made.execute_cdp_cmd("Network.enable", {})
    return made


def opened(browser, path):
    """Open a page from disk and wait until it says that it is ready."""
    browser.get(path.resolve().as_uri())
    wait(browser, "return document.documentElement.dataset.ready")
    ready = browser.execute_script("return document.documentElement.dataset.ready")
    assert ready == "yes", complaints(browser)


def wait(browser, script):
    """Wait until a script returns something true, and return it."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        if found := browser.execute_script(script):
            return found
        time.sleep(0.1)
    raise AssertionError(f"never true: {script}; {browser.get_log('browser')}")


def requests(browser):
    """All addresses that the page asked for since the browser began."""
    messages = (json.loads(entry["message"])["message"] for entry in browser.get_log("performance"))
    return [
        message["params"]["request"]["url"]
        for message in messages
        if message["method"] == "Network.requestWillBeSent"
    ]


def complaints(browser):
    """What the console had to say that is worse than information."""
    return [
        entry for entry in browser.get_log("browser") if entry["level"] in ("WARNING", "SEVERE")
    ]
