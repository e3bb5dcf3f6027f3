"""What a policy does not know of its robot: settings and draws (`draw`), and the kernels that they need (`kernels`)."""
