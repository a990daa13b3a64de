"""The proof: effects concealed, found and modelled, each figure made anew from seeds and from real recordings."""
