"""Many cameras in one run: the dataset list, its cameras, masks, views and batches."""
