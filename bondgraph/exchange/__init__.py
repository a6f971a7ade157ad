"""Models for other tools: functional mock-up units."""
