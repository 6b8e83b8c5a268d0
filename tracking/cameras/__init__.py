"""Camera models: world to image and back."""
