"""An OpenID provider on this machine that signs in whom a test names, with nobody's password.

It holds those who ask to the protocol: a code is good for once, and only with the secret of the
client and the verifier of its challenge.
"""

import base64
import hashlib
import json
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit

from joserfc import jwt
from joserfc.jwk import RSAKey

CLIENT, CLIENT_SECRET = "accpinn", "known to both"


@dataclass(eq=False)
class Provider:
    """A running provider."""

    address: str
    email: str = ""
    """Whom it signs in; nobody, with an error, while empty."""
    key: RSAKey = field(default_factory=lambda: RSAKey.generate_key(2048, {"kid": "1"}))
    asked: dict[str, dict[str, str]] = field(default_factory=dict)
    """What was asked, by the code that was given for it and not used yet."""

    @property
    def metadata(self) -> dict[str, Any]:
        """What a client learns first."""
        ends = {"authorization": "authorize", "token": "token", "userinfo": "userinfo"}
        return {
            "issuer": self.address,
            **{f"{name}_endpoint": f"{self.address}/{path}" for name, path in ends.items()},
            "jwks_uri": f"{self.address}/keys",
            "response_types_supported": ["code"],
            "subject_types_supported": ["public"],
            "id_token_signing_alg_values_supported": ["RS256"],
            "code_challenge_methods_supported": ["S256"],
        }

    def redirect(self, asked: dict[str, str]) -> str:
        """Where the browser goes back to, with a code or an error."""
        answer = {"state": asked["state"]}
        if self.email:
            answer["code"] = secrets.token_urlsafe()
            self.asked[answer["code"]] = asked | {"email": self.email}
        else:
            answer["error"] = "access_denied"
        return f"{asked['redirect_uri']}?{urlencode(answer)}"

    def token(self, given: dict[str, str], authorization: str) -> dict[str, str] | None:
        """The tokens for a code; None where anything is wrong."""
        asked = self.asked.pop(given.get("code", ""), None)
        credentials = base64.b64encode(f"{CLIENT}:{CLIENT_SECRET}".encode()).decode()
        digest = hashlib.sha256(given.get("code_verifier", "").encode()).digest()
        challenge = base64.urlsafe_b64encode(digest).decode().rstrip("=")
        if not asked or authorization != f"Basic {credentials}":
            return None
        if (asked["code_challenge"], asked["redirect_uri"]) != (challenge, given["redirect_uri"]):
            return None
        now = int(time.time())
        claims = {
            "iss": self.address, "aud": CLIENT, "sub": asked["email"], "iat": now,
            "exp": now + 600, "nonce": asked["nonce"], "email": asked["email"],
            "email_verified": True,
        }  # fmt: skip
        signed = jwt.encode({"alg": "RS256", "kid": "1"}, claims, self.key)
        return {"access_token": "none", "token_type": "Bearer", "id_token": signed}


@contextmanager
def provider() -> Iterator[Provider]:
    """One that runs as long as it is needed."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            url = urlsplit(self.path)
            if url.path == "/authorize":
                self.send_response(302)
                self.send_header("Location", found.redirect(dict(parse_qsl(url.query))))
                self.end_headers()
            elif url.path == "/keys":
                self._answer({"keys": [found.key.as_dict(private=False)]})
            else:
                self._answer(found.metadata)

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"])).decode()
            tokens = found.token(dict(parse_qsl(body)), self.headers.get("Authorization", ""))
            self._answer(tokens or {"error": "invalid_grant"}, 200 if tokens else 400)

        def _answer(self, content: Any, status: int = 200) -> None:
            raw = json.dumps(content).encode()
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(raw)))
            self.end_headers()
            self.wfile.write(raw)

        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    found = Provider(f"http://127.0.0.1:{server.server_port}")
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield found
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
