"""Generated pairs of pictures for a Siamese tracker: a target, and where it is some frames later."""
