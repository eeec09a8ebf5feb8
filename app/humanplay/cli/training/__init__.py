"""Commands about policies: train, refine and sweep them, evaluate them on the same terrains, and measure speed."""
