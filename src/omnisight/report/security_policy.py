"""The security policy of pages: no network, and no script but their own."""

import base64
import hashlib


def security_policy(style: str, script: str, *, is_served: bool = False) -> str:
    """Return a policy that allows no network access, and no script but the page's own.

    A page that this program serves may also load images and data from it.
    """
    served = "img-src 'self' data:; connect-src 'self'" if is_served else "img-src data:"
    return (
        f"default-src 'none'; {served}; style-src '{_digest(style)}'; script-src '{_digest(script)}';"
        " base-uri 'none'; form-action 'none'"
    )


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
