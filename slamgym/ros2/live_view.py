"""A live view in the browser: the map, the robot, frontiers and path, and buttons that stop it or let it go on.

It is served on this machine alone (``ssh -L 8000:localhost:8000 ROBOT`` brings it to another). Pages of other sites
can't use it: they can neither name it as their host nor send the header that an order has.
"""

import json
import queue
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, NamedTuple

from slamgym.core.errors import ConfigError
from slamgym.core.pictures import encode_png
from slamgym.core.types import FloatArray, OccupancyGrid, Pose2D

ADDRESS = "127.0.0.1"
ORDERS = ("stop", "start", "return_to_start")
"""What the buttons ask for: the node's services of the same names."""
ORDER_HEADER = "X-Slamgym-Order"
"""Header of an order: a browser sends it to this page's own address only."""
LIVE_PAGE = Path(__file__).parent / "views" / "live.html"


class LiveState(NamedTuple):
    """A moment of an exploration, in the map frame [m]."""

    text: str
    """What the node says."""
    grid: OccupancyGrid | None = None
    pose: Pose2D | None = None
    driven: tuple[tuple[float, float], ...] = ()
    frontiers: tuple[FloatArray, ...] = ()  # each (N, 2)
    chosen: FloatArray | None = None  # (N, 2)
    path: FloatArray | None = None  # (N, 2)

    def as_dict(self) -> dict[str, Any]:
        """The same for the page, without the cells; points to the centimetre."""
        frame = None
        if self.grid is not None:
            left, bottom, right, top = self.grid.frame.bounds
            frame = {"left": left, "bottom": bottom, "right": right, "top": top}
        return {
            "text": self.text,
            "map": frame,
            "version": id(self.grid),
            "pose": None if self.pose is None else [round(float(value), 3) for value in self.pose],
            "driven": [[round(x, 2), round(y, 2)] for x, y in self.driven],
            "frontiers": [_points(points) for points in self.frontiers],
            "chosen": _points(self.chosen),
            "path": _points(self.path),
        }


def _points(points: FloatArray | None) -> list[list[float]]:
    return [] if points is None else points[:, :2].round(2).tolist()


class LiveView:
    """Serves a page until :meth:`close`.

    Args:
        port: On this machine; 0 takes a free one.

    Attributes:
        port: The same, or the one that was free.
        orders: What the buttons asked for, the oldest first; the node's own thread carries them out.

    Raises:
        ConfigError: If the port is taken or not allowed.
    """

    def __init__(self, port: int) -> None:
        self.state = LiveState("waiting for the node")
        self.orders: queue.SimpleQueue[str] = queue.SimpleQueue()
        try:
            self._server = _Server((ADDRESS, port), self)
        except (OSError, OverflowError) as error:
            raise ConfigError(
                f"--view {port}: the port can't be used ({error}); name another"
            ) from None
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """For the browser."""
        return f"http://localhost:{self.port}"

    def show(self, state: LiveState) -> None:
        """Show a moment from now on."""
        self.state = state

    def close(self) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], view: LiveView) -> None:
        self.view = view
        super().__init__(address, _Handler)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = 10.0  # a browser that holds a connection open without a word holds a thread

    def do_GET(self) -> None:
        """Send the page, the state or the map."""
        if not self._is_own():
            return
        state = self.server.view.state
        what = self.path.partition("?")[0]
        if what == "/":
            self._send("text/html; charset=utf-8", LIVE_PAGE.read_bytes())
        elif what == "/state":
            self._send("application/json", json.dumps(state.as_dict()).encode())
        elif what == "/map.png" and state.grid is not None:
            self._send("image/png", encode_png(state.grid.cells))
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Take an order."""
        if not self._is_own():
            return
        order = self.headers.get(ORDER_HEADER, "")
        if order not in ORDERS:
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        self.server.view.orders.put(order)
        self._send("text/plain", b"")

    def _is_own(self) -> bool:
        """True if the page was asked for by its own address; answers else."""
        port = self.server.view.port
        if self.headers.get("Host") in (f"localhost:{port}", f"{ADDRESS}:{port}"):
            return True
        self.send_error(HTTPStatus.FORBIDDEN)
        return False

    def _send(self, kind: str, content: bytes) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: Any) -> None:
        """Say nothing: the node's own words matter."""
