"""Opens a dump in the Rerun viewer without a screen, turns it to a tick, and takes and judges pictures of it.

`viewer.sh` beside this folder calls it, in a home of its own, with the interpreter of a virtual environment that has
rerun-sdk and Pillow:

    headless.py driver                     is there a Vulkan device?
    headless.py program                    where the viewer is
    headless.py picture DUMP TICK OUT.png  the viewer at a tick, without its title bar; `last` is a tick
    headless.py check DUMP                 is every view of the dump filled, without a word of warning?
"""

import ctypes
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

WINDOW = (1600, 1000)
# The viewer's title bar, in points: it tells of the machine (software rendering, latency), not of the dump.
TITLE_BAR = 28
# Two levels of a color channel that differ by more are told apart by an eye.
LEVELS = 24
# The share of a view's pixels that stand out from its background. Measured: a view without data has at most 0.007 (the
# headings of the log), the emptiest with data 0.03 (three curves).
INK = 0.015
# The share of the scene's pixels that change when the contacts are left out. Measured: two pictures of one dump differ
# by 0; a hundred contacts change 0.005.
CONTACTS = 0.0005
# What the viewer may write: its address, of which it is asked. The two parts that would tell about a driver in software
# stay silent; everything else that is a warning or an error counts.
LOG_LEVELS = "warn,re_grpc_server=info,re_renderer::context=error,egui_wgpu=error"
# The views that every dump opens with, by name; the others show series.
SCENE, LOG = "scene", "log"


def vulkan_devices():
    """How many devices the Vulkan loader finds: `vkCreateInstance` and `vkEnumeratePhysicalDevices` of Vulkan 1.0."""

    class InstanceCreateInfo(ctypes.Structure):
        _fields_ = [
            ("type", ctypes.c_uint32), ("next", ctypes.c_void_p), ("flags", ctypes.c_uint32),
            ("application", ctypes.c_void_p), ("layer_count", ctypes.c_uint32), ("layers", ctypes.c_void_p),
            ("extension_count", ctypes.c_uint32), ("extensions", ctypes.c_void_p),
        ]

    try:
        vulkan = ctypes.CDLL("libvulkan.so.1")
    except OSError:
        return 0
    instance, devices = ctypes.c_void_p(), ctypes.c_uint32()
    if vulkan.vkCreateInstance(ctypes.byref(InstanceCreateInfo(type=1)), None, ctypes.byref(instance)) != 0:
        return 0
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(devices), None)
    return devices.value


def viewer_program():
    """The viewer itself: the command `rerun` of the package is a wrapper around it, which would outlive a signal."""
    import rerun_cli

    return str(Path(rerun_cli.__file__).with_name("rerun"))


class Viewer:
    """A headless viewer of one dump, driven through its own control protocol (`rerun viewer-mcp`)."""

    def __init__(self, program, dump, scratch):
        self.scratch = Path(tempfile.mkdtemp(dir=scratch))
        # The viewer remembers layouts at home: each one starts with an empty home.
        home = str(self.scratch)
        environment = os.environ | dict(HOME=home, XDG_RUNTIME_DIR=home, RUST_LOG=LOG_LEVELS, NO_COLOR="1")
        quiet = dict(env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        subprocess.run([program, "analytics", "disable"], check=True, **quiet)
        self.processes = []
        self.requests = 0
        self.log = self.scratch / "log"
        with self.log.open("w", encoding="utf-8") as log:
            size = "x".join(map(str, WINDOW))
            arguments = ["--headless", "--window-size", size, "--port", "auto", "--bind", "127.0.0.1"]
            command = [program, str(dump), *arguments]
            self.processes.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log))
        pipes = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.control = subprocess.Popen([program, "viewer-mcp"], env=environment, **pipes)
        self.processes.append(self.control)

    def __enter__(self):
        try:
            self._connect()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _connect(self):
        client = dict(protocolVersion="2024-11-05", capabilities={}, clientInfo=dict(name="headless", version="1"))
        self._request("initialize", client)
        self._send(dict(method="notifications/initialized"))
        self.call("connect", endpoint=f"http://{self._address()}")
        self._wait_until_loaded()

    def __exit__(self, *_):
        for process in reversed(self.processes):
            process.terminate()
        for process in self.processes:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _address(self):
        for _ in range(300):
            address = re.search(r"Listening for gRPC connections on (\S+:\d+)", self.log.read_text("utf-8"))
            if address:
                return address[1]
            if self.processes[0].poll() is not None:
                break
            time.sleep(0.1)
        sys.exit(f"the viewer did not start:\n{self.log.read_text('utf-8')}")

    def _send(self, message):
        self.control.stdin.write(json.dumps(dict(jsonrpc="2.0") | message) + "\n")
        self.control.stdin.flush()

    def _request(self, method, parameters):
        self.requests += 1
        self._send(dict(id=self.requests, method=method, params=parameters))
        for line in self.control.stdout:
            answer = json.loads(line)
            if answer.get("id") == self.requests:
                return answer
        sys.exit(f"the viewer went away:\n{self.log.read_text('utf-8')}")

    def call(self, tool, **arguments):
        """The text that a tool of the control protocol answers."""
        answer = self._request("tools/call", dict(name=tool, arguments=arguments))
        result = answer.get("result", {})
        if "error" in answer or result.get("isError"):
            sys.exit(f"the viewer refused {tool} {arguments}: {answer}\n{self.log.read_text('utf-8')}")
        return "\n".join(part.get("text", "") for part in result["content"])

    def _wait_until_loaded(self):
        """Until three looks in a row find the same recording with the same ranges of time."""
        looks = []
        for _ in range(100):
            looks.append(self.ticks())
            if len(looks) >= 3 and looks[-1] is not None and looks[-1] == looks[-2] == looks[-3]:
                return
            self.call("wait_for", min_steps=3, timeout_secs=20)
            time.sleep(0.1)
        sys.exit(f"the viewer did not finish loading:\n{self.log.read_text('utf-8')}")

    def ticks(self):
        """The first and last tick of the recording, or () where it has none; None before there is a recording."""
        recordings = json.loads(self.call("viewer_state"))["recordings"]
        if not recordings:
            return None
        return next(((line["min"], line["max"]) for line in recordings[0]["timelines"] if line["timeline"] == "tick"), ())

    def turn_to(self, tick):
        self.call("set_time", timeline="tick", time=tick)

    def picture(self):
        """The window below the title bar, as soon as two pictures in a row are the same."""
        from PIL import Image

        path = self.scratch / "picture.png"
        last = None
        for _ in range(20):
            self.call("wait_for", min_steps=5, timeout_secs=30)
            self.call("screenshot", save_path=str(path))
            with Image.open(path) as image:
                picture = image.convert("RGB").crop((0, TITLE_BAR, *image.size))
            if last is not None and picture.tobytes() == last.tobytes():
                break
            last = picture
        return picture

    def views(self):
        """Where each view lies in the picture, by its name: left, top, right, bottom."""
        rectangles = {}
        for node in json.loads(self.call("query_tree", role="Pane"))["nodes"]:
            # The panels around the views are panes too.
            if re.search(r"^_|_panel$", node["label"]):
                continue
            box = node["bounds"]
            left, top = round(box["x"]), round(box["y"]) - TITLE_BAR
            rectangles[node["label"]] = (left, top, left + round(box["w"]), top + round(box["h"]))
        return rectangles

    def complaints(self):
        lines = self.log.read_text("utf-8").splitlines()
        return [line for line in lines if re.search(r"\b(WARN|ERROR)\b|panicked", line)]


def share(difference):
    """The share of pixels of a difference of pictures that an eye tells apart."""
    from PIL import ImageChops

    if 0 in difference.size:
        return 0.0
    red, green, blue = difference.split()
    strongest = ImageChops.lighter(ImageChops.lighter(red, green), blue)
    return sum(strongest.histogram()[LEVELS + 1:]) / (difference.width * difference.height)


def ink(picture, rectangle):
    """The share of a view's pixels that are not its background, which is its most frequent color."""
    from PIL import Image, ImageChops

    view = picture.crop(rectangle)
    if 0 in view.size:
        return 0.0
    _, background = max(view.getcolors(view.width * view.height))
    return share(ImageChops.difference(view, Image.new("RGB", view.size, background)))


def changed(one, other, rectangle):
    """The share of a view's pixels that differ between two pictures."""
    from PIL import ImageChops

    return share(ImageChops.difference(one.crop(rectangle), other.crop(rectangle)))


def without(program, dump, twin, dropped):
    """Writes a twin of a dump without the entities that are `dropped`."""
    statistics = subprocess.run([program, "rrd", "stats", dump], check=True, capture_output=True, text=True).stdout
    # One line for each entity: "/contacts/points/cloth: 3".
    entities = [entity for entity in re.findall(r"^(/.*): \d+$", statistics, re.MULTILINE) if dropped(entity)]
    if not entities:
        sys.exit(f"{dump} has no entity of those that were to be left out")
    filters = [argument for entity in entities for argument in ("--drop-entity", entity)]
    command = [program, "rrd", "filter", *filters, "--output", twin, dump]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def is_data(entity):
    """Whether an entity is neither part of the layout nor of the recording's own description."""
    return not re.match(r"/((view|container)/|(viewport|\w+_panel|__properties)$)", entity) and entity != "/"


def is_contact(entity):
    return entity.startswith("/contacts/")


def photograph(program, dump, scratch):
    """The dump at its last tick: its picture, its views, and what the viewer complained of on the way there."""
    with Viewer(program, dump, scratch) as viewer:
        ticks = viewer.ticks()
        for tick in sorted({ticks[0], sum(ticks) // 2, ticks[1]}) if ticks else ():
            viewer.turn_to(tick)
            picture = viewer.picture()
        if not ticks:
            picture = viewer.picture()
        return picture, viewer.views(), viewer.complaints()


def check(program, dump, scratch):
    blank, bare = scratch / "blank.rrd", scratch / "bare.rrd"
    without(program, dump, blank, is_data)
    without(program, dump, bare, is_contact)
    picture, views, failures = photograph(program, dump, scratch)

    for name in (SCENE, LOG):
        if name not in views:
            failures.append(f'no view "{name}" among {sorted(views)}')
    if len(views) < 3:
        failures.append(f"no view of series among {sorted(views)}")
    for name, rectangle in views.items():
        filled = ink(picture, rectangle)
        print(f"{name}: {filled:.4f} of the pixels stand out")
        if filled < INK:
            failures.append(f'the view "{name}" is blank: {filled:.4f} of its pixels stand out, fewer than {INK}')
    # The same judgment of the same layout without data: were it to pass there, it would say nothing here.
    blank_picture, blank_views, _ = photograph(program, blank, scratch)
    for name, rectangle in blank_views.items():
        filled = ink(blank_picture, rectangle)
        if filled >= INK:
            failures.append(f'the view "{name}" without data would pass as filled: {filled:.4f}')
    if views.keys() != blank_views.keys():
        failures.append(f"without data there are other views: {sorted(blank_views)}")

    if SCENE in views:
        shown = changed(picture, photograph(program, bare, scratch)[0], views[SCENE])
        unsteady = changed(picture, photograph(program, dump, scratch)[0], views[SCENE])
        print(f"contacts: {shown:.4f} of the scene's pixels show them, {unsteady:.4f} differ from run to run")
        if shown < CONTACTS:
            failures.append(f"the contacts cannot be seen: {shown:.5f} of the scene's pixels are theirs")
        if unsteady >= CONTACTS:
            failures.append(f"pictures of one dump differ: {unsteady:.5f} of the scene's pixels")
    if failures:
        sys.exit("\n".join(failures))


def take_picture(program, dump, tick, out, scratch):
    with Viewer(program, dump, scratch) as viewer:
        ticks = viewer.ticks()
        if not ticks:
            sys.exit(f"{dump} has no ticks")
        viewer.turn_to(ticks[1] if tick == "last" else int(tick))
        viewer.picture().save(out, optimize=True)


def main(command, *arguments):
    # So that the viewer is ended also when this program is.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    if command == "driver":
        sys.exit(0 if vulkan_devices() else 1)
    program = viewer_program()
    if command == "program":
        print(program)
        return
    with tempfile.TemporaryDirectory() as scratch:
        if command == "check":
            check(program, *arguments, Path(scratch))
        elif command == "picture":
            take_picture(program, *arguments, scratch)
        else:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(*sys.argv[1:])
