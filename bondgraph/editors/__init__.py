"""Editors: colours and short configurations, all made of the language's one table of words."""
