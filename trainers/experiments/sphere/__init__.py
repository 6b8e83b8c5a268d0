"""The sphere paper: a ball before calibrated cameras, and a flying drone before six."""
