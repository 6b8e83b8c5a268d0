"""Ready configuration files, one flat YAML per run."""
