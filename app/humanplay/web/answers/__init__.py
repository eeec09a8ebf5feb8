"""What the API answers: a module of response models for each subject."""
