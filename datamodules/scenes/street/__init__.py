"""Streets with walking people: single pictures to train on, clips with exact truth."""
