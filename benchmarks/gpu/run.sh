#!/bin/bash
# On a machine with a GPU and without a network, in a copy of a checkout in which benchmarks.gpu.pack has run:
#   bash .gpu/run.sh [MINUTES]
# $OUT receives bits.md, gpu.md, gpu.json and log. OIIOTEX_DEVICE selects another device.
minutes=${1:-8}
out=${OUT:-gpu-out}
device=${OIIOTEX_DEVICE:-gpu}
mkdir -p "$out"
exec > >(tee "$out/log") 2>&1
site=$(mktemp -d)
python3 -m pip install -q --no-index --no-deps --no-compile --no-cache-dir --target "$site" .gpu/wheels/*.whl || exit 1
export PYTHONPATH=$site:$PWD PYTHONUNBUFFERED=1
# the driver of NVIDIA may come without the file that names its OpenCL
library=$({ ldconfig -p | awk '/libnvidia-opencl\.so/{print $NF}'
  find /usr/local/nvidia /usr/lib /usr/lib64 /opt -name 'libnvidia-opencl.so*' 2>/dev/null; } | head -1)
if [ -n "$library" ]; then
  icd=$(mktemp -d)
  library=$(readlink -f "$library")
  echo "$library" > "$icd/nvidia.icd"
  export OCL_ICD_VENDORS=$icd LD_LIBRARY_PATH="$(dirname "$library"):${LD_LIBRARY_PATH:-}"
else
  echo "No OpenCL of NVIDIA is here. What is:"
  ls /etc/OpenCL/vendors /usr/local/nvidia /usr/local/nvidia/lib64 2>/dev/null
fi
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv 2>/dev/null
python3 -m oiiotex -v --devices
# bits first (a minute), then speed and tests
timeout $((minutes * 20)) python3 -m benchmarks.gpu.compare check .gpu/expected --device "$device" --out "$out/bits.md"
timeout $((minutes * 60)) python3 -m benchmarks.gpu.run --device "$device" --minutes "$minutes" --out "$out/gpu.md" \
  > /dev/null
head -c 9000 "$out/gpu.md"
