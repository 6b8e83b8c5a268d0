"""People in video: found and described, then linked."""
