"""Commands about policies: train, refine, sweep and clone them, evaluate them on the same terrains, and measure speed."""
