"""Time of a run cut into smooth segments, and the records of an integration over them."""
