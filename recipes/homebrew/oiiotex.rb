# Homebrew formula. `brew update-python-resources oiiotex` fills in the Python packages that Homebrew lacks.
class Oiiotex < Formula
  include Language::Python::Virtualenv

  desc "Texture filters for OpenImageIO and OpenColorIO pipelines, on OpenCL"
  homepage "https://github.com/oiiotex/oiiotex"
  url "https://pypi.org/packages/source/o/oiiotex/oiiotex-0.1.0.tar.gz"
  sha256 "0000000000000000000000000000000000000000000000000000000000000000" # of the release: RELEASE.md
  license "Apache-2.0"

  depends_on "numpy"
  depends_on "opencolorio"
  depends_on "openimageio"
  depends_on "pocl"
  depends_on "python@3.13"
  depends_on "scipy"

  def install
    virtualenv_install_with_resources
  end

  test do
    assert_match "oiiotex #{version}", shell_output("#{bin}/oiiotex --version")
  end
end
