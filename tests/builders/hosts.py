"""Invalid Host headers: names of other machines, or strings that a lenient parser accepts as a loopback address."""

FOREIGN_HOSTS = (
    *("", "evil.example", "evil.example:8000", "10.0.0.2", "0.0.0.0", "[::2]"),
    *("127.0.0.1.evil.example", "localhost.", "127.0.0.1.", "127.1", "2130706433", "0x7f.0.0.1"),
    *("a@localhost", "evil.example@127.0.0.1", "evil@localhost:80", "localhost:80@evil", "localhost\\\\@evil"),
    *("[::1]evil", "[::1].evil.example", "evil[::1]", "::1", "[::1", "[::1%25lo]", "[localhost]", "[]"),
    *("localhost:port", "localhost:", "localhost:1:2", "localhost:-1", "localhost:+1", "localhost:999999"),
    *("localhost:\xb2", "local\thost", "localhost evil", "localhost,evil", "%6cocalhost"),
    *("localhost/x", "localhost?x", "localhost#x", "//localhost", "http://localhost"),
)
"""Host headers that a loopback server must refuse: none is a loopback name with or without a port."""
