OPTIONS = ()


def print_input(chain, image):
    pass
