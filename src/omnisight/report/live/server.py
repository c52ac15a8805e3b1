"""The server of a page that shows a running command, on 127.0.0.1 only."""

import json
import threading
from dataclasses import dataclass
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from types import TracebackType
from typing import Any, Self

from numpy.typing import NDArray

from omnisight.images import encode_image
from omnisight.report.html import Markup, element
from omnisight.report.security_policy import security_policy

HOST = "127.0.0.1"


@dataclass(frozen=True)
class Shown:
    """What the page shows.

    Attributes
    ----------
    number
        Increases with each change.
    image
        JPEG file; empty before the first.
    advice
        The line above the image.
    rows
        Names and values below it.
    """

    number: int = 0
    image: bytes = b""
    advice: str = ""
    rows: tuple[tuple[str, str], ...] = ()

    def to_json(self) -> bytes:
        """Return all but the image as JSON."""
        return json.dumps({"number": self.number, "advice": self.advice, "rows": self.rows}).encode()


class LivePage:
    """A page that shows the newest image and figures of a running command.

    It is served on this computer only, at a free port, and loads nothing from the network. Requests for another host
    are refused: no page of the network can read the images through a name that points here.
    """

    def __init__(self, title: str) -> None:
        """Start the server."""
        self.shown = Shown()
        self.html = _page(title).encode()
        self._server = ThreadingHTTPServer((HOST, 0), partial(_Handler, self))
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port."""
        return int(self._server.server_address[1])

    @property
    def url(self) -> str:
        """The address to open in a browser."""
        return f"http://{HOST}:{self.port}/"

    def show(self, image: NDArray[Any], advice: str, rows: dict[str, str]) -> None:
        """Replace the image (H, W, 3) of uint8, the line above and the figures below it."""
        jpeg = encode_image(image, "image.jpg")
        self.shown = Shown(self.shown.number + 1, jpeg, advice, tuple(rows.items()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Handler(BaseHTTPRequestHandler):
    """Answers GET requests of the page's three addresses."""

    def __init__(self, page: LivePage, *arguments: Any) -> None:
        self.page = page
        super().__init__(*arguments)

    def do_GET(self) -> None:
        shown = self.page.shown
        answers = {
            "/": ("text/html; charset=utf-8", self.page.html),
            "/state.json": ("application/json", shown.to_json()),
            "/image.jpg": ("image/jpeg", shown.image),
        }
        hosts = {f"{name}:{self.page.port}" for name in (HOST, "localhost")}
        kind, body = answers.get(self.path.partition("?")[0], ("", b""))
        if self.headers.get("Host") not in hosts or not body:
            self.send_error(404)
            return
        self.send_response(200)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),
            ("X-Content-Type-Options", "nosniff"),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: the terminal shows the progress."""


def _page(title: str) -> str:
    """Return the HTML text of the page."""
    style, script = (
        files("omnisight.report.live").joinpath(name).read_text("utf-8") for name in ("live.css", "live.js")
    )
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=security_policy(style, script, is_served=True)),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("link", rel="icon", href="data:,"),
        element("title", title),
        element("style", Markup(style)),
    )
    body = element(
        "body",
        element("h1", title),
        element("p", id="advice", aria_live="polite"),
        element("img", alt=""),
        element("dl"),
        element("p", id="state"),
        element("script", Markup(script)),
    )
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"
