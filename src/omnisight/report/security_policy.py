"""The security policy of pages: no network, and no script but their own."""

import base64
import hashlib


def security_policy(style: str, script: str) -> str:
    """Return a policy that allows no network access, and no script but the page's own."""
    return (
        f"default-src 'none'; img-src data:; style-src '{_digest(style)}'; script-src '{_digest(script)}';"
        " base-uri 'none'; form-action 'none'"
    )


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
