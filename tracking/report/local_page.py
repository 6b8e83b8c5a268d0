"""What every page that is served to this computer has in common: who may ask, and what its answers forbid.

A page has an address that cannot be guessed. A request without it, under another host's name, or from a page of another
site is refused.
"""

from __future__ import annotations

import hmac
import os
import secrets
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

HOST = "127.0.0.1"
# A result has a port of its own, of these, so that its page stays where it is.
PORTS = range(20_000, 30_000)
# Seconds for which a request may stay silent before its connection is closed.
SILENT = 10
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def refusal(path: str, headers: Mapping[str, str], token: str, port: int) -> str:
    """Why a request is refused; empty where it asks the right host, from its own page, with the token.

    Args:
        path: of the request, which begins with the token.
        headers: by name; upper and lower case are the same.
        token: of the page.
        port: on which it is served.
    """
    host = headers.get("host", "")
    if host not in (f"{HOST}:{port}", f"localhost:{port}"):
        return f"This page answers under {HOST}:{port} only."
    # A link in a report may open the page, which nothing frames; all else is asked by the page itself.
    opens = headers.get("sec-fetch-mode") == "navigate" and path.strip("/").count("/") == 0
    own_site = opens or headers.get("sec-fetch-site", "none") in ("none", "same-origin")
    if not own_site or headers.get("origin", f"http://{host}") != f"http://{host}":
        return "Another site asked for this page. Copy its address from the terminal into a new tab."
    if not secrets.compare_digest(f"{path}/".split("/")[1].encode(errors="replace"), token.encode()):
        return "This address lacks its token. Open the whole address that tsuiseki printed."
    return ""


def port_of(token: str) -> int:
    """Of the page of that token."""
    return PORTS[int(token, 16) % len(PORTS)]


def address_of(folder: Path) -> str:
    """Of the page of a result's folder, while it is served."""
    token = token_of(folder)
    return f"http://{HOST}:{port_of(token)}/{token}/"


def token_of(folder: Path) -> str:
    """Of the page of a result's folder; it stays, so that an open page goes on when the server is started again."""
    from tsuiseki.tracking.weights.catalogue import cache_folder

    place, key = cache_folder().parent / "review.key", secrets.token_bytes(32)
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            number = os.open(place, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
            os.write(number, key)
            os.close(number)
        key = place.read_bytes() or key
    return hmac.new(key, str(folder.resolve()).encode(), "sha256").hexdigest()[:32]
