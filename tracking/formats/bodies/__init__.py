"""Files of bodies that bend: their states and silhouettes."""
