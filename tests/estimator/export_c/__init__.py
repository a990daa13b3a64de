"""The C module beside the Python core it is made of."""
