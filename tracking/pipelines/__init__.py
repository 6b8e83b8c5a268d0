"""A whole video through models and a tracker: what `import tsuiseki` and the commands of `tsuiseki track` both call."""
