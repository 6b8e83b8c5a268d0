"""Parsing and writing of every on-disk format, its quirks and its rules of what is ignored, each in one place.

The contract of all files here:

* ``is_X(path) -> bool`` looks whether something is of the format X, and never fails;
* ``find_X(folder)`` lists the videos of a data set, without their labels;
* ``read_X(path) -> …`` gives what is in a file, in the toolkit's terms: 0-based frames, boxes as corners in 0-based
  pixels; it raises `RequestError`, with file and line, where the content is not what it should be;
* ``write_X(path, …)`` writes what ``read_X`` gives back.

The files here are of labelled people and of one labelled target. `sensors` has those of measured points, `bodies` those
of bodies that bend, `space` those of places in the world. What is read is defined in `tsuiseki.tracking.types`.
`labelled.open_labelled` opens labelled video of any layout.
"""
