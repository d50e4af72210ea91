"""The operator's seat: from head, stick and mouse to the head of the catheter, and back."""
