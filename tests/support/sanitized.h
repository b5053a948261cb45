// SPDX-License-Identifier: Apache-2.0
#pragma once

// In builds whose sanitizer owns malloc and locks nothing can stand in front of them.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BENDLOOP_SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define BENDLOOP_SANITIZED 1
#endif
#endif
