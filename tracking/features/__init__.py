"""What is measured on an image: detections and appearance, by exported networks."""
