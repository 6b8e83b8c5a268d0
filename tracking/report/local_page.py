"""What every page that is served to this computer has in common: who may ask, and what its answers forbid.

A page has an address that cannot be guessed. A request without it, under another host's name, or from a page of another
site is refused.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping

HOST = "127.0.0.1"
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
    own_site = headers.get("sec-fetch-site", "none") in ("none", "same-origin")
    if not own_site or headers.get("origin", f"http://{host}") != f"http://{host}":
        return "Another site asked for this page. Copy its address from the terminal into a new tab."
    if not secrets.compare_digest(f"{path}/".split("/")[1].encode(errors="replace"), token.encode()):
        return "This address lacks its token. Open the whole address that tsuiseki printed."
    return ""
