"""What the packages share: names on the wire, how command lines and sockets are read, and expressions."""
