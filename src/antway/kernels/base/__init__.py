"""What every room of kernels may use."""
