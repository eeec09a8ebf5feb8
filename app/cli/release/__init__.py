"""Commands about bundles: release a study, reproduce its figures from the bundle alone, import a bundle's episodes."""
