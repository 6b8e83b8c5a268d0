"""Files of measured points: what a sensor measured, the model of it, and tracks of points."""
