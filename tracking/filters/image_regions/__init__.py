"""The PHD filter on image regions: targets that are no measured points but coloured parts of the image."""
