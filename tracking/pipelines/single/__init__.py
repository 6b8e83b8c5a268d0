"""One target, from the box it begins with."""
