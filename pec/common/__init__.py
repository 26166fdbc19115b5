"""What several folders of this package, and `pecgrasp_env`, share."""
