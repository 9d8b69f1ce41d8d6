"""What the laboratory and its clients share: names on the wire, and how command lines and sockets are read."""
