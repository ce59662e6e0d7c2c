"""How the shipped weights, figures and card are made. The product never imports it."""
