// SPDX-License-Identifier: AGPL-3.0-or-later
// OpenSSL's libcrypto rather than a small implementation of our own: it uses the processor's SHA
// instructions, so that a volume of a gigabyte costs a second and not ten.
#include "cvmesh/core/error.h"
#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/sha256.h"

#include <array>
#include <openssl/evp.h>
#include <vector>

namespace cvmesh {

struct Sha256::State {
  EVP_MD_CTX* context = EVP_MD_CTX_new();

  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;

  ~State() { EVP_MD_CTX_free(context); }
};

namespace {

void check(int rc) {
  require(rc == 1, ErrorCode::Internal, "read",
          "OpenSSL cannot compute a SHA-256 digest; look at its configuration (OPENSSL_CONF)");
}

}  // namespace

Sha256::Sha256() : state_(std::make_unique<State>()) {
  check(EVP_DigestInit_ex(state_->context, EVP_sha256(), nullptr));
}

Sha256::~Sha256() = default;

void Sha256::update(std::span<const std::byte> bytes) {
  check(EVP_DigestUpdate(state_->context, bytes.data(), bytes.size()));
}

std::string Sha256::hex() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  check(EVP_DigestFinal_ex(state_->context, digest.data(), &size));
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (unsigned int i = 0; i < size; ++i) {
    text += kDigits[digest[i] >> 4];
    text += kDigits[digest[i] & 15];
  }
  return text;
}

std::string sha256_of_file(const std::filesystem::path& path) {
  constexpr std::size_t kBlock = 1 << 20;
  detail::ByteSource source(path, detail::Storage::Raw);
  std::vector<std::byte> block(kBlock);
  Sha256 hash;
  while (const std::size_t count = source.read(block.data(), block.size()))
    hash.update({block.data(), count});
  return hash.hex();
}

}  // namespace cvmesh
