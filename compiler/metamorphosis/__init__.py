"""Changes of texts that keep their meaning."""
