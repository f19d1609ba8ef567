"""Recipe of nunet's Serial U-Nets: the zoo, its training, evaluation, quantisation and export."""
