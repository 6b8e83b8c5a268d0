"""Parsing and writing of every on-disk format, its quirks and its rules of what is ignored, each in one place.

The contract of all files here:

* ``is_X(path) -> bool`` checks whether something is of the format X, and never fails;
* ``find_X(folder)`` lists the videos of a data set, without their labels;
* ``read_X(path) -> …`` gives what is in a file, in the toolkit's terms: 0-based frames, boxes as corners in 0-based
  pixels; it raises `RequestError`, with file and line, where the content is not what it should be;
* ``write_X(path, …)`` writes what ``read_X`` gives back.

Each file is one format, or one family of them: `measurement_tables` are of a sensor, `body_states`, `body_points` and
`sleap_hdf5` of bodies that bend, `world_tables` of places in space.
`labelled.open_labelled` opens labelled video of any layout. What is read is defined in `tsuiseki.tracking.types`.
"""
