"""Who may drive the page: Host, Origin and token, each alone, and the link that passes all three."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchgap.viewer.gate import Gate, Refusal, exposed

PORT = 8080
HERE = Gate("127.0.0.1")


def passed(gate, path=None, host=f"127.0.0.1:{PORT}", origins=(), port=PORT):
    return gate.passes(f"/{gate.token}/" if path is None else path, [host], origins, port)


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080"])
def test_loopback_is_known_by_all_its_names(host):
    assert passed(HERE, host=host) == "/"
    assert passed(HERE, host=host, origins=[f"http://{host}"]) == "/"


@pytest.mark.parametrize(
    "host", ["", "evil.example:8080", "127.0.0.1", "127.0.0.1:8081", "a@127.0.0.1:8080", "127.0.0.1:8080.evil.example"]
)
def test_any_other_host_is_refused(host):
    assert isinstance(passed(HERE, host=host), Refusal)


def test_no_host_and_two_hosts_are_refused():
    for hosts in ([], [f"127.0.0.1:{PORT}"] * 2):
        assert isinstance(HERE.passes(f"/{HERE.token}/", hosts, [], PORT), Refusal)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "", "https://127.0.0.1:8080", "http://localhost:8080"]
)
def test_any_other_origin_is_refused(origin):
    assert isinstance(passed(HERE, origins=[origin]), Refusal)


def test_a_machine_that_listens_everywhere_is_known_by_its_addresses_and_its_own_name(monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "Bench")
    gate = Gate("0.0.0.0")
    for host in ("192.168.1.5:8080", "bench:8080", "[fe80::1]:8080", "localhost:8080"):
        assert passed(gate, host=host) == "/"
    for host in ("evil.example:8080", "bench.evil.example:8080", "192.168.1.5:80", "[192.168.1.5]:8080"):
        assert isinstance(passed(gate, host=host), Refusal)
    assert gate.url(PORT) == f"http://127.0.0.1:8080/{gate.token}/"
    assert gate.url(PORT, "bench").startswith("http://bench:8080/")


@pytest.mark.parametrize(("host", "link"), [("0.0.0.0", "127.0.0.1"), ("0", "127.0.0.1"), ("::", "[::1]")])
def test_the_link_of_a_machine_that_listens_everywhere_is_one_on_which_it_listens(host, link):
    """Python's servers listen on :: for IPv6 alone."""
    assert Gate(host).url(PORT).startswith(f"http://{link}:8080/")


def test_a_host_that_the_user_named_is_known_by_that_name():
    gate = Gate("bench.lan")
    assert passed(gate, host="bench.lan:8080") == "/"
    assert isinstance(passed(gate, host="192.168.1.5:8080"), Refusal)
    assert Gate("::1").url(PORT).startswith("http://[::1]:8080/")


def test_the_usual_port_is_left_out_of_host():
    assert passed(HERE, host="127.0.0.1", origins=["http://127.0.0.1"], port=80) == "/"


@given(st.text(max_size=60))
def test_nothing_but_the_token_opens_the_page(token):
    assert isinstance(passed(HERE, f"/{token}/"), Refusal) or token.startswith((HERE.token, "?"))
    assert isinstance(passed(HERE, token), Refusal)


def test_what_is_behind_the_token_is_asked_of_viser():
    assert [passed(HERE, f"/{HERE.token}{rest}") for rest in ("", "/", "/a/b.js", "/?websocket=x", "?x")] == [
        "/", "/", "/a/b.js", "/", "/",
    ]  # fmt: skip


def test_every_page_has_a_token_of_its_own_that_is_not_shown_by_accident():
    tokens = {Gate("127.0.0.1").token for _ in range(50)}
    assert len(tokens) == 50
    assert min(map(len, tokens)) >= 32
    assert HERE.token not in repr(HERE)
    refusal = passed(HERE, "/")
    assert HERE.token not in refusal.words
    assert "\n" not in refusal.words


def test_only_loopback_is_not_exposed():
    assert [exposed(host) for host in ("127.0.0.1", "localhost", "::1", "0.0.0.0", "192.168.1.5")] == [
        False, False, False, True, True,
    ]  # fmt: skip
