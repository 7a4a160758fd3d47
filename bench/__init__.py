"""How fast and how right: the paper's recipe beside ours, on the same data and machine."""
