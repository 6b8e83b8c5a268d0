"""Files of people seen from drones, and of what they do."""
