"""Code shared by the packages: protocol names, command line parsing, socket streams and expressions."""
