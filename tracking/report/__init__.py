"""What a person looks at: overlays, pages, plots."""
