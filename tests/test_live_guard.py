"""Which requests the live page answers: no other site's page reads or steers it, and from afar a token is needed."""

from typing import Any

import pytest

from activeslam_gym.live.guard import Guard, is_loopback

LOCAL = ("127.0.0.1", 8080)
OWN = ("localhost:8080", "127.0.0.1:8080", "[::1]:8080", "LocalHost:8080")
FOREIGN_HOSTS = (
    "evil.example", "evil.example:8080", "EVIL.EXAMPLE:8080", "localhost.evil.example:8080", "localhost.:8080",
    "localhost:8081", "localhost", "localhost:", "localhost:80", "localhost:08080", "localhost:8080:8080",
    "localhost:8080.evil.example", "evil.example@localhost:8080", "localhost:8080, evil.example", "0.0.0.0:8080",
    "127.0.0.1.:8080", "127.1:8080", "2130706433:8080", "192.168.1.5:8080", "::1:8080", "[::]:8080", "",
    None, ("localhost:8080",) * 2, ("localhost:8080", "evil.example"),
)  # fmt: skip
FOREIGN_ORIGINS = (
    "https://evil.example", "http://evil.example:8080", "null", "", "file://", "http://localhost", "http://localhost:8081",
    "https://localhost:8080", "http://127.0.0.1:8080", "http://localhost:8080/", "http://localhost:8080.evil.example",
    "http://localhost:80808", "http://evil.example@localhost:8080", "localhost:8080", "ws://localhost:8080",
    "http://localhost:8080 http://evil.example", "chrome-extension://abcdefghijklmnop",
    ("http://localhost:8080",) * 2, ("http://localhost:8080", "null"),
)  # fmt: skip


def refusal(guard: Guard, host: Any = "localhost:8080", origin: Any = None, path: str = "/", local: Any = LOCAL) -> Any:
    hosts, origins = ([] if one is None else [one] if isinstance(one, str) else list(one) for one in (host, origin))
    return guard.refusal(path, hosts, origins, local)


def test_only_own_hosts_and_origins_are_answered() -> None:
    guard = Guard.of("127.0.0.1")
    for host in OWN:
        assert refusal(guard, host) is refusal(guard, host, f"http://{host.lower()}") is None
    for host in FOREIGN_HOSTS:
        assert "Host" in refusal(guard, host) and "Host" in refusal(guard, host, f"http://{host}"), host
    for origin in FOREIGN_ORIGINS:
        assert "page of another site" in refusal(guard, origin=origin), origin
    assert "own machine" in refusal(guard, local=("192.0.2.7", 8080))


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.0.0.2"])
def test_on_loopback_there_is_no_token(host: str) -> None:
    guard = Guard.of(host)
    assert is_loopback(host) and guard.token == "" and guard.inner("/") == "/"
    name = {"127.0.0.1": "localhost", "::1": "[::1]"}.get(host, host)
    assert guard.address(host, 8080) == f"http://{name}:8080"
    assert refusal(guard, f"{name}:8080") is None


@pytest.mark.parametrize("host", ["0.0.0.0", "0", "", "::", "192.0.2.7", "no.such.host.invalid"])
def test_elsewhere_the_token_of_the_address_is_needed(host: str) -> None:
    guard, local = Guard.of(host), ("192.0.2.7", 8080)
    assert not is_loopback(host) and len(guard.token) >= 22 and guard.token != Guard.of(host).token
    own, path = guard.address(host, 8080).removeprefix("http://").split("/", 1)
    assert path == f"{guard.token}/" and refusal(guard, own, f"http://{own}", f"/{path}", local) is None
    assert refusal(guard, "192.0.2.7:8080", None, f"/{guard.token}", local) is None
    wrong = (
        "/", "", "//", guard.token, f"/{guard.token[:-1]}/", f"/{guard.token}x/", f"/x/{guard.token}/",
        f"//{guard.token}/", f"/?{guard.token}", f"/{guard.token.swapcase()}/", "/\udcff/", f"http://{own}/{guard.token}/",
    )  # fmt: skip
    for path in wrong:
        assert "token" in refusal(guard, own, None, path, local), path
    assert "Host" in refusal(guard, "evil.example:8080", None, f"/{guard.token}/", local)
    assert "another site" in refusal(guard, own, "https://evil.example", f"/{guard.token}/", local)
    inside = {"": "/", "/": "/", "/a.js": "/a.js", "//x": "//x"}
    assert {rest: guard.inner(f"/{guard.token}{rest}") for rest in inside} == inside
