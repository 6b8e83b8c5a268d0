"""Any number of points: coloured objects in video, or a sensor's measurements."""
