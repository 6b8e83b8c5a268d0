"""An unknown number of objects: points, blobs and a sensor's measurements."""
