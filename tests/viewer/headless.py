"""Opens a dump in the Rerun viewer without a screen, turns it to a tick, and takes and judges pictures of it.

`viewer.sh` beside this folder calls it, in a home of its own, with the interpreter of a virtual environment that has
rerun-sdk and Pillow:

    headless.py driver                     is there a Vulkan device?
    headless.py program                    where the viewer is
    headless.py check DUMP                 does every view show its part of the dump, without a warning?
    headless.py picture DUMP TICK OUT.png [LAYER | X,Y | X,Y+POINTS]…
                                           the viewer at a tick (`last` is one), without its title bar; in turn each
                                           LAYER is hidden or shown, as its row in the blueprint panel would do it, what
                                           lies at X,Y of the picture is selected, or the wheel is turned there by POINTS,
                                           which brings the middle of the scene nearer
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
# How far one notch of a wheel scrolls, in points.
WHEEL = 50
# Two levels of a color channel that differ by more are told apart by an eye.
LEVELS = 24
# The share of a view's pixels that a layer must change to count as visible there. Measured: two pictures of one
# recording differ by 0, a single line in the log changes 0.0051, a hundred contacts change 0.0066 of the scene.
VISIBLE = 0.0005
# What the viewer may write: its address, of which it is asked. The two parts that would tell about a driver in software
# stay silent; everything else that is a warning or an error counts.
LOG_LEVELS = "warn,re_grpc_server=info,re_renderer::context=error,egui_wgpu=error"
# The views with which every dump opens, by name, and what must be seen there; all further views show series.
SCENE, LOG = "scene", "log"
LAYERS = {"meshes": SCENE, "contacts": SCENE, "log": LOG}
SERIES = "series"


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
        ranges = {line["timeline"]: (line["min"], line["max"]) for line in recordings[0]["timelines"]}
        return ranges.get("tick", ())

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
                return picture
            last = picture
        sys.exit("the viewer does not come to rest")

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

    def _widgets(self, **search):
        """The widgets that match, from the top down."""
        nodes = [node for node in json.loads(self.call("query_tree", **search))["nodes"] if node["bounds"]]
        return sorted(nodes, key=lambda node: node["bounds"]["y"])

    def flip(self, layer):
        """Shows a layer that is hidden, or hides one that is shown."""
        if not self._widgets(role="Pane", label_contains="_blueprint_tree"):
            self.call("click", role="Button", label_contains="Blueprint panel toggle")
            self.call("wait_for", role="Pane", label_contains="_blueprint_tree")
        self.call("click", role="Button", label_contains="Search")
        self.call("type_text", text=layer)
        self.call("wait_for", role="Button", label_contains=layer, timeout_secs=5)
        rows = [row for row in self._widgets(role="Button", label_contains=layer) if row["label"] == layer]
        if not rows:
            sys.exit(f'no row "{layer}" in the blueprint panel')
        # The eye of a row appears under the pointer.
        self.call("hover", id=rows[0]["id"])
        self.call("wait_for", min_steps=5)
        top = rows[0]["bounds"]["y"]
        eyes = self._widgets(role="Button", label_contains="Make ")
        self.call("click", id=min(eyes, key=lambda eye: abs(eye["bounds"]["y"] - top))["id"])
        self.call("press_key", key="Escape")

    def select(self, x, y):
        """Selects what lies at a place of the picture, and opens the panel that tells of it."""
        place = dict(x=x, y=y + TITLE_BAR)
        # What the pointer is over is read back from a drawn frame, and frames are drawn for pictures only.
        self.call("hover", pos=place)
        self.picture()
        self.call("click", pos=place)
        if not self._widgets(role="Pane", label_contains="_selection_panel"):
            self.call("click", role="Button", label_contains="Selection panel toggle")
            self.call("wait_for", role="Pane", label_contains="_selection_panel")

    def scroll(self, x, y, points):
        """Turns the wheel at a place of the picture, which brings the scene nearer there."""
        place = dict(x=x, y=y + TITLE_BAR)
        self.call("hover", pos=place)
        for _ in range(points // WHEEL):
            self.call("scroll", pos=place, delta=dict(x=0, y=-WHEEL))
            self.call("wait_for", min_steps=5)

    def rest(self):
        """Takes the pointer away from everything that would answer to it."""
        self.call("hover", pos=dict(x=WINDOW[0] // 2, y=TITLE_BAR // 2))

    def complaints(self):
        lines = self.log.read_text("utf-8").splitlines()
        return [line for line in lines if re.search(r"\b(WARN|ERROR)\b|panicked", line)]


def changed(one, other, rectangle):
    """The share of a view's pixels that an eye tells apart in two pictures."""
    from PIL import ImageChops

    difference = ImageChops.difference(one.crop(rectangle), other.crop(rectangle))
    if 0 in difference.size:
        return 0.0
    red, green, blue = difference.split()
    strongest = ImageChops.lighter(ImageChops.lighter(red, green), blue)
    return sum(strongest.histogram()[LEVELS + 1:]) / (difference.width * difference.height)


def without(program, dump, twin, dropped):
    """Writes a twin of a dump without the entities of which `dropped` says so."""
    statistics = subprocess.run([program, "rrd", "stats", dump], check=True, capture_output=True, text=True).stdout
    # One line for each entity: "/contacts/points/cloth: 3".
    entities = [entity for entity in re.findall(r"^(/.*): \d+$", statistics, re.MULTILINE) if dropped(entity)]
    if not entities:
        sys.exit(f"{dump} has no entity of those that {twin.stem} is to be without")
    filters = [argument for entity in entities for argument in ("--drop-entity", entity)]
    command = [program, "rrd", "filter", *filters, "--output", twin, dump]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def is_data(entity):
    """Whether an entity is part neither of the layout nor of the recording's own description."""
    return not re.match(r"/((view|container)/|(viewport|\w+_panel|__properties)$)", entity) and entity != "/"


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


def check(program, scratch, dump):
    """A layer is seen where the picture changes as it is left out, by more than two pictures of the same differ."""
    picture, views, failures = photograph(program, dump, scratch)
    plots = sorted(views.keys() - {SCENE, LOG})
    expected = {SCENE, LOG} - views.keys()
    if expected or not plots:
        sys.exit("\n".join([*failures, f"there are views {sorted(views)}, not {SCENE}, {LOG} and at least one plot"]))

    for layer, places in [*((layer, [view]) for layer, view in LAYERS.items()), (SERIES, plots)]:
        twin = scratch / f"{layer}.rrd"
        without(program, dump, twin, lambda entity: entity.startswith(f"/{layer}/"))
        bare, _, _ = photograph(program, twin, scratch)
        for view in places:
            shown = changed(picture, bare, views[view])
            print(f"{layer}: {shown:.4f} of the pixels of {view}")
            if shown < VISIBLE:
                failures.append(f"{layer} cannot be seen in {view}: {shown:.5f} of its pixels, fewer than {VISIBLE}")

    # Judged alike, a recording of nothing must show nothing; else the judgment above is worth nothing.
    blank = scratch / "blank.rrd"
    without(program, dump, blank, is_data)
    (one, _, _), (other, _, _) = (photograph(program, blank, scratch) for _ in range(2))
    for view, rectangle in views.items():
        shown = changed(one, other, rectangle)
        if shown >= VISIBLE:
            failures.append(f"a recording of nothing passes as visible in {view}: {shown:.5f} of its pixels")
    if failures:
        sys.exit("\n".join(failures))


def take_picture(program, scratch, dump, tick, out, *actions):
    with Viewer(program, dump, scratch) as viewer:
        ticks = viewer.ticks()
        if not ticks:
            sys.exit(f"{dump} has no ticks")
        viewer.turn_to(ticks[1] if tick == "last" else int(tick))
        for action in actions:
            numbers = [int(number) for number in re.findall(r"\d+", action)]
            if re.fullmatch(r"\d+,\d+", action):
                viewer.select(*numbers)
            elif re.fullmatch(r"\d+,\d+\+\d+", action):
                viewer.scroll(*numbers)
            else:
                viewer.flip(action)
        viewer.rest()
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
            check(program, Path(scratch), *arguments)
        elif command == "picture":
            take_picture(program, scratch, *arguments)
        else:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(*sys.argv[1:])
